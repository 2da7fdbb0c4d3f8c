"""One frame's problem: a vector of the search in, what it costs against the reference frame out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from ..camera import Camera
from ..features import Features
from .stage import Stage
from .view import View

MOTION = 0.5  # of its weight that flow keeps while frames are refined one by one: where the last one erred, it misleads
EQUAL = 1e-6  # by which two vectors differ at most that are one, in the units of x


@dataclass(frozen=True)
class Problem:
    """One reference frame, and how a vector is scored against it.

    Args:
        stage: renders and scores.
        search: vectors to cameras.
        home: the initial view.
        reference: the frame.
        before: view of the frame before as it was found, None for the first.
        defined: which terms the reference has, (L,) bool.
        free_lens: whether x holds the lens.
    """

    stage: Stage
    search: Any
    home: Camera
    reference: Features
    before: View | None
    defined: Tensor  # (L,)
    free_lens: bool

    @property
    def dimensions(self) -> int:
        """D."""
        return self.search.dimensions if self.free_lens else self.search.dimensions - 1

    @property
    def bounds(self) -> tuple[Tensor, Tensor]:
        """Lowest and highest x, (D,) each."""
        low, high = self.search.bounds()
        return low[: self.dimensions], high[: self.dimensions]

    def cameras(self, x: Tensor) -> Camera:
        """B cameras of x (B, D)."""
        return self.search.cameras(x, self.home, self.stage.scene.subject)

    def totals(self, x: Tensor) -> Tensor:
        """Totals (B,) of x (B, D)."""
        return self.weighted(x).sum(dim=1)

    def weighted(self, x: Tensor) -> Tensor:
        """Weighted terms (B, L) of x (B, D), undefined ones priced; they add up to the totals."""
        terms = self.stage.terms(self.reference, self.cameras(x), self.before)
        return self.stage.objective.weighted(terms, self.defined)

    def residuals(self, x: Tensor) -> Tensor:
        """Residuals (B, R) of x (B, D) as one frame is refined by them: weighted, flow by :data:`MOTION` less."""
        residuals = self.stage.residuals(self.reference, self.cameras(x), self.before, self.defined)
        return residuals * motion_scale(self.stage.objective.paired)

    def aimed(self, x: Tensor) -> Tensor:
        """x (B, D) moved so that the subject stands where the reference has it, where the search can tell."""
        if not hasattr(self.search, "aimed") or not self.reference.has("keypoints"):
            return x[:0]
        return self.search.aimed(x, self.home, self.stage.scene.subject, self.reference)


def motion_scale(paired: Tensor) -> Tensor:
    """What each residual (R,) is scaled by while frames are refined one by one."""
    return torch.where(paired, MOTION, 1.0).double()


def distinct(x: Tensor, tolerance: float = EQUAL) -> Tensor:
    """The vectors of x (S, D) that differ from all before them, in their order.

    >>> distinct(torch.tensor([[1.0, 2.0], [0.0, 2.0], [1.0, 2.0]]))
    tensor([[1., 2.],
            [0., 2.]])
    """
    equal = torch.isclose(x[:, None], x, rtol=0.0, atol=tolerance).all(-1)  # (S, S)
    return x[~equal.tril(-1).any(1)]
