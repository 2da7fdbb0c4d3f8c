"""What floaters that a search did not see cost what it found, and when that is too much."""

from __future__ import annotations

from dataclasses import dataclass

WORSE, MUCH = 4 / 3, 0.1  # times another total, and so much more, above which one is far worse


@dataclass(frozen=True)
class LeftOut:
    """Floaters that a search did not see.

    Args:
        count: Gaussians.
        alone: mean total of what was found, in the scene without them.
        among: the same with them, in the scene as it was given.
    """

    count: int
    alone: float
    among: float

    @property
    def matters(self) -> bool:
        """Whether what was found is far worse with them."""
        return far_worse(self.among, self.alone)

    def better(self, other: LeftOut) -> bool:
        """Whether this gains more with them than it loses without them against the ``other``, and is not far worse."""
        lost, gained = self.alone - other.alone, other.among - self.among
        return gained > max(lost, 0.0) and not far_worse(self.alone, other.alone)


def far_worse(total: float, other: float) -> bool:
    """Whether ``total`` is far above the ``other``.

    >>> far_worse(0.15, 0.05), far_worse(0.2, 0.05), far_worse(1.4, 1.0), far_worse(1.5, 1.0)
    (False, True, False, True)
    """
    return total > WORSE * other + MUCH
