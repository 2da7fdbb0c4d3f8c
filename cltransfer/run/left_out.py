"""What floaters that a search did not see cost what it found, and when that is too much."""

from __future__ import annotations

from dataclasses import dataclass

WORSE, MUCH = 4 / 3, 0.1  # times another total, and so much more, above which one is far worse
BEARABLE = 0.25  # so much more, where floaters make up for it; what they alone make good is 0.8 worse without them


@dataclass(frozen=True)
class LeftOut:
    """Floaters that a search did not see.

    Args:
        alone: mean total of what was found, in the scene without them, over all frames, 0 where none has a term.
        among: the same with them, in the scene as it was given.
    """

    alone: float
    among: float

    @property
    def matters(self) -> bool:
        """Whether what was found is far worse with them."""
        return far_worse(self.among, self.alone)

    def better(self, other: LeftOut) -> bool:
        """Whether it gains more with floaters than it loses without, and is not far worse there than ``other``."""
        lost, gained = self.alone - other.alone, other.among - self.among
        return gained > max(lost, 0.0) and not far_worse(self.alone, other.alone, BEARABLE)


def far_worse(total: float, other: float, much: float = MUCH) -> bool:
    """Whether ``total`` is far above the ``other``: by a third, and by ``much``.

    >>> far_worse(0.15, 0.05), far_worse(0.2, 0.05), far_worse(1.4, 1.0), far_worse(1.5, 1.0)
    (False, True, False, True)
    """
    return total > WORSE * other + much
