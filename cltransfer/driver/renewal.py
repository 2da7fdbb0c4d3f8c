"""When a Jacobian that is carried along a clip is measured afresh: soon where that helps, seldom where it does not."""

from __future__ import annotations

from dataclasses import dataclass

WORSE = 1.5  # times the median so far, that a frame may end at before its Jacobian is doubted
STUCK = 0.1  # total below which it is not, half a tolerance of one term
HELPED = 0.5  # of its total, that a frame ends at by a new Jacobian if the old one was to blame
TRIAL = 2  # steps with a new Jacobian that show whether it helps
LONGER = 2  # times as many frames go by after a new Jacobian that did not help


@dataclass(frozen=True)
class Renewal:
    """How long the Jacobian has been carried, and how long it has to be.

    Args:
        carried: frames since it was measured.
        wait: frames from one measurement to the next, at least.
    """

    carried: int = 0
    wait: int = 1

    def next(self) -> Renewal:
        """One frame later."""
        return Renewal(self.carried + 1, self.wait)

    def due(self, total: float, usual: float) -> bool:
        """Whether a frame that ended at ``total`` is to be refined again with a new one.

        Args:
            total: of the frame.
            usual: the median of the frames before it.
        """
        return self.carried >= self.wait and total > max(STUCK, WORSE * usual)

    def measured(self) -> Renewal:
        """After it was measured because a frame has terms that none had before."""
        return Renewal(0, self.wait)

    def done(self, before: float, after: float) -> Renewal:
        """After it was measured for a frame that ended at ``before``, and with the new one at ``after``."""
        return Renewal(0, 1 if helped(before, after) else LONGER * self.wait)


def helped(before: float, after: float) -> bool:
    """Whether a new Jacobian, that took a frame from total ``before`` to ``after``, was worth its measurement."""
    return after < HELPED * before
