"""Searches: vectors an optimiser moves, cameras a renderer takes. One module per search."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Protocol

from ..errors import ModelError, named

if TYPE_CHECKING:
    from torch import Tensor

    from ..camera import Camera
    from ..subject import Subject


class Search(Protocol):
    """What the driver needs of a search; a frozen dataclass whose fields are its options.

    The last parameter is always the lens. A vector without it keeps the focal length of ``home``, so that any search
    can be run with a fixed lens.
    """

    dimensions: int
    """D, with the lens."""
    needs_subject: bool
    """Whether it is centred on a lifted subject."""

    def bounds(self) -> tuple[Tensor, Tensor]:
        """Lowest and highest x, (D,) each, in units of which a step of 1 is a large move."""
        ...

    def cameras(self, x: Tensor, home: Camera, subject: Subject | None) -> Camera:
        """B cameras of x (B, D) or, at the focal length of ``home``, (B, D - 1)."""
        ...

    # Optional: refinable, False where the slopes about a camera do not tell every move; the engine refine is then cma.
    # Optional: lens, the direction (D,) of x along which the focal length changes.
    # Optional: aside, moves (W, D) of x by which the camera goes past something that hides the person; nearby, moves to
    # views that hardly differ, for a camera that stands where a loss has a step.
    # Optional: aimed(x, home, subject, reference) -> x: x moved, without rendering, so that the subject's known joints
    # appear where and as large as one reference frame has them. `guide` needs subject_orbit.
    # Optional: turned(x, to) -> x: of all x (B, D) of the same cameras, those nearest to ``to`` (D,).
    # Optional: recentred(x, home) -> x, home: the same camera as x (D,) about itself, where Adam starts from.
    # Optional: names, D words for what ended at a bound; bounding, by name the options of its low bound and its high.
    # Optional: limited(x) -> (B,) bool: which of x (B, D) ask for a shorter or longer lens than there is.
    # Optional: unit_note(subject) -> text: what is doubtful in the unit of the scene, or nothing.
    # Optional: unbounded, a slice of x whose bounds are no limit to the camera, see limits.

    def vector(self, camera: Camera, home: Camera, subject: Subject | None) -> Tensor:
        """x (B, D) of B cameras, as near as the parameters can express them."""
        ...


def limits(search: Any, dimensions: int) -> tuple[Tensor, Tensor]:
    """Lowest and highest x, (dimensions,) each, that limit the camera; infinite where a bound means nothing."""
    low, high = (bound[:dimensions].clone() for bound in search.bounds())
    unbounded = getattr(search, "unbounded", slice(0))
    low[unbounded], high[unbounded] = -math.inf, math.inf
    return low, high


def check_search(search: Any, home: Camera, subject: Subject | None) -> None:
    """Ask a search once for what the driver asks it for first.

    Args:
        search: of whoever wrote it.
        home: a view that it is to express.
        subject: of the scene.

    Raises:
        ModelError: its bounds or its vector have not the shapes that its ``dimensions`` say.
    """
    from ..registry import SEARCHES

    who, D = f"search {SEARCHES.name_of(search)!r}", search.dimensions
    (low, high), x = search.bounds(), search.vector(home, home, subject)  # what they raise is told with their file
    with named(who, "expected bounds and vectors that are tensors"):
        told = [("low bounds", low, (D,)), ("high bounds", high, (D,)), ("a vector", x, (1, D))]
        shapes = [(what, tuple(tensor.shape), expected) for what, tensor, expected in told]
    for what, came, expected in shapes:
        if came != expected:
            raise ModelError("", who, f"expected {what} of shape {expected}, got {came}", f"its dimensions are {D}")
