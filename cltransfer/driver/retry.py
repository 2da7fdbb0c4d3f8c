"""What is tried where a frame ends far worse than usual: soon again where that helped, ever less often where not."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Retry:
    """The rule, and how far along the clip it is.

    Args:
        worse: times the median of the frames before, that a frame has to end above.
        gain: share of its total, that a frame ends below where trying was worth it.
        longer: times as many frames go by after a try that was not.
        since: frames since the last try, or since the first frame.
        wait: frames from one try to the next, at least.
    """

    worse: float
    gain: float
    longer: int
    since: int = 0
    wait: int = 1

    def next(self) -> Retry:
        """One frame later."""
        return replace(self, since=self.since + 1)

    def due(self, total: float, usual: float, limit: float) -> bool:
        """Whether it is to be tried for a frame that ended at ``total``.

        Args:
            total: of the frame.
            usual: the median of the frames before it.
            limit: total up to which a frame is good enough.
        """
        return self.since >= self.wait and total > max(limit, self.worse * usual)

    def helped(self, before: float, after: float) -> bool:
        """Whether it was worth it for a frame that ended at ``before``, and ``after`` by it."""
        return after < self.gain * before

    def needless(self) -> Retry:
        """After a frame for which it was done anyway."""
        return replace(self, since=0)

    def done(self, before: float, after: float) -> Retry:
        """After a frame for which it was tried, see :meth:`helped`."""
        return replace(self, since=0, wait=1 if self.helped(before, after) else self.longer * self.wait)


RENEWAL = Retry(worse=1.5, gain=0.5, longer=2)  # a Jacobian that is carried along the clip, measured afresh
RESCUE = Retry(worse=4.0, gain=0.7, longer=4)  # CMA-ES, after least squares
