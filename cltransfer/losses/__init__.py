"""Losses, which are the metrics too. One module per loss; its name is the file's name."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Protocol

if TYPE_CHECKING:
    from torch import Tensor

    from ..features import Features


class Loss(Protocol):
    """What the objective needs of a loss; a frozen dataclass whose fields are its options.

    Optional: ``residuals(reference, rendered) -> (B, R)`` for refiners that use least squares, with ``groups``, the
    group of each of the R: the loss is the sum over the groups of the norm of their residuals; ``signs``, what it means
    that each of them is positive ("larger"), by which an ablation tells which way its rows err, and
    ``directions(reference, rendered) -> (B, R)`` with NaN where one of them is a cost and no direction;
    ``beyond(reference, rendered) -> (B, R, 2)`` where they jump: what each is beyond the jump, and how far it is from
    there, 0 or less where it is there, NaN where none is known of; ``uses``, features it takes from either side that
    has them: it is defined without.
    """

    requires: ClassVar[tuple[str, ...]]
    """Features both sides must have; where the reference lacks one the loss is undefined and reported so."""
    unit: ClassVar[str]
    """Unit of the raw value, for tables and charts."""
    penalty: ClassVar[float]
    """Raw value the objective uses where the loss is NaN: about the worst that a person inside the frame can have."""
    weight: float
    """lambda of Eq. 15."""

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        """Raw, unweighted loss, (B,), >= 0; NaN where undefined. ``reference`` has 1 or B frames."""
        ...
