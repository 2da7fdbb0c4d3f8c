"""When CMA-ES searches a frame that least squares left far above the others: ever less often where it does not help."""

from __future__ import annotations

from dataclasses import dataclass

FAR = 4.0  # times the median of the frames before, that a frame has to end above
HELPED = 0.7  # of its total, that a frame ends below where the search was worth it
LONGER = 4  # times as many frames go by after a search that was not


@dataclass(frozen=True)
class Rescue:
    """How many frames ago one was searched so, and how many it has to be.

    Args:
        since: frames since then, or since the first.
        wait: frames from one such search to the next, at least.
    """

    since: int = 0
    wait: int = 1

    def next(self) -> Rescue:
        """One frame later."""
        return Rescue(self.since + 1, self.wait)

    def due(self, total: float, usual: float, limit: float) -> bool:
        """Whether a frame that ended at ``total`` is to be searched so.

        Args:
            total: of the frame.
            usual: the median of the frames before it.
            limit: total up to which a frame is good enough.
        """
        return self.since >= self.wait and total > max(limit, FAR * usual)

    def done(self, before: float, after: float) -> Rescue:
        """After a frame that ended at ``before`` was searched so, and ``after``."""
        return Rescue(0, 1 if after < HELPED * before else LONGER * self.wait)
