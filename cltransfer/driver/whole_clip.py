"""A clip as a whole: paths scored, and what the losses make of them. All of it counts as evaluations."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..camera import Camera
from ..features import Features
from ..pipeline.objective import Across, group_norms
from ..search import limits
from .jumps import Jumps
from .refine import STEP, inside, inward
from .spline import Local
from .stage import Stage


@dataclass(frozen=True)
class WholeClip:
    """A clip to find a path for.

    Args:
        stage: renders and scores.
        search: vectors to cameras.
        reference: N frames.
        home: the initial view.
        at: places of the frames along the clip, (N,), see :func:`cltransfer.along_clip.places`; None are evenly
            spaced.
    """

    stage: Stage
    search: Any
    reference: Features
    home: Camera
    at: Tensor | None = None  # (N,)

    @cached_property
    def defined(self) -> Tensor:
        """Which terms the reference has, (N, L) bool."""
        return self.stage.objective.defined(self.reference)

    @cached_property
    def placed(self) -> Tensor:
        """Frames (N,) bool of which the reference tells where to stand; the others cost nothing wherever that is."""
        return self.stage.objective.placed(self.reference)

    @cached_property
    def placed_share(self) -> float:
        """Share of frames that are :attr:`placed`; a mean total over all frames is diluted by it. 1 where none is."""
        return float(self.placed.double().mean()) or 1.0

    def cameras(self, x: Tensor) -> Camera:
        """N cameras of x (N, D)."""
        return self.search.cameras(x, self.home, self.stage.scene.subject)

    def inside(self, x: Tensor, kept: Tensor | None = None) -> Tensor:
        """A path x (N, D) moved onto the limits where it goes beyond, as splines do of frames at a limit.

        What clamping takes along ``kept`` (D,), as the lens, is added back through coordinates at no limit; a standing
        path is only clamped.
        """
        bounds = limits(self.search, x.shape[1])
        found = inside(x, bounds)
        if kept is None or bool((x == x[:1]).all()) or torch.equal(found, x):
            return found
        free = torch.where(found == x, kept, 0.0)  # (N, D)
        share = ((x - found) @ kept) / (free**2).sum(1).clamp_min(1e-12)
        return inside(found + share[:, None] * free, bounds)

    def about(self, home: Camera, x: Tensor) -> Tensor:
        """A path x (N, D) as the same cameras are written about another ``home``; about the subject it stays as is."""
        if self.search.needs_subject:
            return x
        return self.search.vector(self.cameras(x), home, self.stage.scene.subject)[:, : x.shape[1]]

    def lens(self, dimensions: int) -> Tensor | None:
        """Direction (D,) of x along which the focal length changes; None where it does not."""
        return getattr(self.search, "lens", None) if dimensions == self.search.dimensions else None

    def aside(self, dimensions: int, lens_kept: bool = False, stands: bool = False) -> Tensor | None:
        """Moves (W, D) of x by which the camera goes a little aside; None where the search has none.

        One that ``stands`` is also tried nearby, with another lens too where x has it, as that stays the same along the
        clip.
        """
        ways: Tensor | None = getattr(self.search, "aside", None)
        if ways is not None and stands and hasattr(self.search, "nearby"):
            ways = torch.cat([ways, self.search.nearby])
        if ways is None:
            return None
        ways = ways[(ways[:, dimensions:] == 0).all(1)][:, :dimensions]
        lens = self.lens(dimensions) if lens_kept and not stands else None
        return ways if lens is None else ways[(ways @ lens).abs() < 1e-9]

    def total(self, x: Tensor) -> float:
        """Mean total of a path (N, D); one evaluation a frame."""
        return self.scored(x)[0]

    def scored(self, x: Tensor) -> tuple[float, Tensor | None]:
        """Mean total of a path (N, D), and its residuals (N, R) where every loss has some; one evaluation a frame."""
        objective = self.stage.objective
        if objective.groups is not None:
            residuals = self.residuals(x)
            return self.mean_total(residuals), residuals
        terms = self.stage.path_terms(self.reference, self.cameras(x), guarded=True)
        self.stage.spent.evaluations += views(x)
        return float(objective.totals(terms, self.defined).mean()), None

    def mean_total(self, residuals: Tensor) -> float:
        """Mean total of a path's residuals (N, R); a frame of which nothing is defined has 0, whatever is found."""
        return float(self.totals(residuals).mean())

    def totals(self, residuals: Tensor) -> Tensor:
        """Total of each frame (N,), of a path's residuals (N, R)."""
        groups = self.stage.objective.groups
        assert groups is not None
        return group_norms(residuals, groups).sum(1)

    def residuals(self, x: Tensor) -> Tensor:
        """Weighted residuals (N, R) of a path (N, D); one evaluation a frame.

        Raises:
            ValueError: a loss has no residuals.
        """
        found = self.stage.path_residuals(self.reference, self.cameras(x), self.defined)
        self.stage.spent.evaluations += views(x)
        return found

    def across(self, x: Tensor, seen: bool = False) -> Across:
        """Residuals of a path (N, D), and beyond jumps of the losses; one evaluation a frame if it was not ``seen``."""
        if not seen:
            self.stage.spent.evaluations += views(x)
        return self.stage.path_across(self.reference, self.cameras(x), self.defined)

    def still_totals(self, x: Tensor, frame: int) -> Tensor:
        """Totals (B,) of x (B, D) for one frame, of the losses that need no other one; B evaluations."""
        stage = self.stage
        defined = self.defined[frame] & ~stage.objective.of_motion
        return self.totals(stage.residuals(self.reference[frame], self.cameras(x), None, defined))

    def part(self, moved: Tensor, x: Tensor, first: int, last: int) -> Tensor:
        """Residuals (last - first, R) of those frames of the path ``moved`` (N, D), what is before them as in x (N, D).

        One evaluation for each frame, and one for the frame before, which the flow of the first one starts from.
        """
        begin = max(first - 1, 0)
        path = torch.cat([x[begin:first], moved[first:last]])
        frames = slice(begin, last)
        found = self.stage.path_residuals(self.reference[frames], self.cameras(path), self.defined[frames])
        self.stage.spent.evaluations += views(path)
        return found[first - begin :]

    def local(
        self,
        x: Tensor,
        residuals: Tensor,
        step: float = STEP,
        shared: int = 1,
        first: int = 0,
        jumps: Jumps | None = None,
    ) -> Local:
        """What the losses make of a path (N, D), by differences of ``step``.

        Neighbours have nearly the same Jacobian, so each frame may measure every ``shared``-th direction only, starting
        from another one than the frame before, and take the others from the frames around it; D / ``shared``
        evaluations a frame. Where none would of a residual that few frames have, one of these does. Each frame itself,
        which the flow of the next one starts from, is rendered only where it was not seen lately.

        Args:
            x: the path.
            residuals: of the path, (N, R).
            step: of the differences, in the units of x; backwards where forwards leaves the limits.
            shared: frames that measure all directions together, at least 1.
            first: direction that the first frame measures first.
            jumps: that the path is to be led across; ``residuals`` are :meth:`Jumps.values` then, and so is what comes.

        Raises:
            ValueError: a loss has no residuals.
        """
        stage, objective = self.stage, self.stage.objective
        if objective.groups is None:
            raise ValueError("a path is refined by the residuals of every loss")
        N, D = x.shape
        shared = min(shared, max(1, N - 1))  # the first frame has no flow: another one measures what it does
        rows, paired = torch.stack([objective.rows(frame) for frame in self.defined]), objective.paired
        if jumps is not None:
            rows = torch.cat([rows, jumps.led, jumps.led], dim=1)
            paired = torch.cat([paired, torch.zeros_like(rows[0, len(paired) :])])
        measured = (torch.arange(D) + torch.arange(N)[:, None] + first) % shared == 0  # (N, D)
        stands = standing(x)
        measured &= ~stands[:, None]
        measured |= (stands & ~stands.roll(1)).roll(-1)[:, None]  # one frame measures for all that stand after it
        for r, d in ((rows.double().T @ measured.double() == 0) & rows.any(0)[:, None]).nonzero().tolist():
            having = rows[:, r].nonzero()[:, 0]
            if not measured[having, d].any():  # of a residual that few frames have one measures what none would
                measured[having[len(having) // 2], d] = True
        steps = inward(x, step, limits(self.search, D))  # (N, D)
        jacobians = torch.zeros(N, rows.shape[1], D, dtype=torch.float64)
        for i, before in enumerate(chain([None], stage.path(self.cameras(x[:-1])))):
            directions = measured[i]
            if directions.any():
                around = x[i] + torch.diag(steps[i])[directions]
                told = (self.reference[i], stage.view(self.cameras(around), before), self.defined[i])
                r = stage.told(*told) if jumps is None else jumps.values(stage.told_across(*told))
                jacobians[i][:, directions] = ((r - residuals[i]) / steps[i][directions, None]).T
                stage.spent.evaluations += len(around)
        return Local(residuals, between(jacobians, measured, rows), objective.groups, paired)


def standing(x: Tensor) -> Tensor:
    """Frames (N,) bool of a path (N, D) that show what the frame before does: two before them stand there too.

    >>> standing(torch.tensor([[1.0], [1.0], [1.0], [1.0], [2.0]])).tolist()
    [False, False, True, True, False]
    """
    kept = torch.zeros(len(x), dtype=torch.bool)
    kept[1:] = (x[1:] == x[:-1]).all(1)
    return kept & torch.cat([kept[:1], kept[:-1]])


def views(x: Tensor) -> int:
    """How many views a path (N, D) has; a camera that stands has two, with and without a frame before."""
    return len(x) - int(standing(x).sum())


def between(jacobians: Tensor, measured: Tensor, rows: Tensor) -> Tensor:
    """Jacobians of every frame, of those that measured a direction around it; 0 where a frame has no such residual.

    Args:
        jacobians: as they were measured, (N, R, D).
        measured: directions that a frame measured, (N, D) bool.
        rows: residuals that a frame has, (N, R) bool.
    """
    found = torch.zeros_like(jacobians)
    frames = np.arange(len(measured))
    patterns, pattern_of = torch.unique(rows.T, dim=0, return_inverse=True)
    for p, there in enumerate(patterns):
        same = pattern_of == p
        for d, known in enumerate(measured.T & there):
            at = frames[known.numpy()]
            if len(at):
                weights = np.stack([np.interp(frames, at, column) for column in np.eye(len(at))], axis=1)  # (N, K)
                found[:, same, d] = torch.from_numpy(weights) @ jacobians[at][:, same, d]
    return found * rows[..., None]
