"""The whole clip at once: the path of least order (static, linear, a few knots) that costs no more than its frames.

Frames found one by one jitter as far as their losses let them, and a frame that moves makes the flow of the next one
wrong. A spline through all of them is solved for jointly; the least order within the noise floor is taken, then the
lens is kept still where that costs nothing either.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from ..camera import Camera
from ..features import Features
from ..objective import group_norms
from ..tracks import along
from .refine import STEP
from .spline import Fitted, Local, fit
from .stage import Stage

LEAST_FLOOR = 0.02  # total that nobody sees, a fiftieth of a tolerance
SHARE = 0.1  # of the free path's total that its own minima are uncertain by: neighbours end in other ones
TRUSTED = 0.1  # total below which the Jacobians that the frames ended with describe the clip
JUMPS = 0.3  # total that a filtered path may cost more than frames that jump: no loss sees a jump of one frame
JUMPS_SHARE = 0.5  # of their total that it may be at most: where frames fit that well, they move so by right
FILTERS = (2.0, 1.0)  # [frames] standard deviation of the filter where no spline will do
TRIED = 3  # paths evaluated, of those of which the linear model says that they are good enough
CLEARLY = 0.9  # of the total that the last one promised
FAR = 3.0  # times the total allowed; above it the linear model does not hold


@dataclass(frozen=True)
class WholeClip:
    """A clip to find a path for.

    Args:
        stage: renders and scores.
        search: vectors to cameras.
        reference: N frames.
        home: the initial view.
    """

    stage: Stage
    search: Any
    reference: Features
    home: Camera

    def cameras(self, x: Tensor) -> Camera:
        """N cameras of x (N, D)."""
        return self.search.cameras(x, self.home, self.stage.scene.subject)

    def lens(self, dimensions: int) -> Tensor | None:
        """Direction (D,) of x along which the focal length changes; None where it does not."""
        return getattr(self.search, "lens", None) if dimensions == self.search.dimensions else None

    def total(self, x: Tensor) -> float:
        """Mean total of a path (N, D); one evaluation a frame."""
        objective = self.stage.objective
        if objective.groups is not None:
            return float(group_norms(self.residuals(x), objective.groups).sum(1).mean())
        terms = self.stage.path_terms(self.reference, self.cameras(x))
        self.stage.spent.evaluations += len(x)
        return float(objective.totals(terms, objective.defined(self.reference)).mean())

    def residuals(self, x: Tensor) -> Tensor:
        """Weighted residuals (N, R) of a path (N, D); one evaluation a frame.

        Raises:
            ValueError: a loss has no residuals.
        """
        found = self.stage.path_residuals(self.reference, self.cameras(x))
        self.stage.spent.evaluations += len(x)
        return found

    def local(self, x: Tensor) -> Local:
        """What the losses make of a path (N, D), by differences; D + 1 evaluations a frame.

        Raises:
            ValueError: a loss has no residuals.
        """
        stage, objective = self.stage, self.stage.objective
        if objective.groups is None:
            raise ValueError("a path is refined by the residuals of every loss")
        defined, before = objective.defined(self.reference), None
        residuals, jacobians = [], []
        for i in range(len(x)):
            around = torch.cat([x[i : i + 1], x[i] + STEP * torch.eye(x.shape[1], dtype=x.dtype)])
            seen = stage.features(self.cameras(around), before)
            r = stage.priced(self.reference[i], seen, defined[i])
            residuals.append(r[0])
            jacobians.append(((r[1:] - r[0]) / STEP).T)
            before = seen[0]
        stage.spent.evaluations += len(x) * (x.shape[1] + 1)
        return Local(torch.stack(residuals), torch.stack(jacobians), objective.groups, objective.paired)


@dataclass(frozen=True)
class LeastPath:
    """The path taken.

    Args:
        x: (N, D).
        knots: a dimension; None is every frame for itself.
        filtered: standard deviation of the filter along the clip, where there are no knots [frames]; 0 is none.
        lens_kept: whether the focal length stays the same.
        total: mean over the frames.
        free: the same of the frames as they were found.
        floor: how much more than that it may cost.
    """

    x: Tensor  # (N, D)
    knots: int | None
    filtered: float
    lens_kept: bool
    total: float
    free: float
    floor: float

    @property
    def jumps(self) -> bool:
        """Whether every frame was left as it was found, though there are several."""
        return self.knots is None and not self.filtered and len(self.x) > 1

    @property
    def name(self) -> str:
        """In words, for reports."""
        if self.filtered:
            return f"every frame, filtered over {self.filtered:g}"
        order = {None: "every frame", 1: "static", 2: "linear"}.get(self.knots, f"{self.knots} knots")
        return f"{order}, focal length kept" if self.lens_kept and self.knots != 1 else order


def orders(frames: int) -> list[int]:
    """Knots to choose from: one, or at most one for two frames, since more would shake like the frames themselves.

    >>> orders(24)
    [1, 2, 4, 6, 8, 12]
    """
    ladder, step = [1, 2, 4], 6
    while step < frames:
        ladder += [step, step + step // 3]
        step *= 2
    return [knots for knots in ladder if knots <= max(1, frames // 2)]


def bearable(total: float) -> float:
    """What a filtered path may cost more than frames that jump at a mean total of ``total``."""
    return min(JUMPS, JUMPS_SHARE * total)


def least_path(clip: WholeClip, x: Tensor, local: Local | None, free: float, noise: float, rounds: int) -> LeastPath:
    """The least order that stays within the noise floor of the path as it was found.

    Args:
        clip: what it is a path for.
        x: the path as it was found, (N, D).
        local: what the losses make of it, as its frames ended; None where they were not refined by residuals.
        free: its mean total.
        noise: how far totals are uncertain, because the reference was read by networks; 0 where it is exact.
        rounds: of fresh Jacobians along the path, where the loss is not small already.
    """
    path = LeastPath(x, None, 0.0, False, free, free, noise + LEAST_FLOOR + SHARE * free)
    if len(x) == 1:
        return path
    if clip.stage.objective.groups is None or clip.stage.plan.passes or free <= TRUSTED:
        rounds = 0  # differences taken through noisy networks mislead
    if rounds:
        local = clip.local(x)
    path = _least_order(clip, path, local)
    for _ in range(rounds - 1):
        if path.knots is None:
            break
        local = clip.local(path.x)
        path = _nearer(clip, path, fit(path.x, local, path.knots, clip.lens(x.shape[1]) if path.lens_kept else None))
    return path


def _least_order(clip: WholeClip, free: LeastPath, local: Local | None) -> LeastPath:
    limit = free.free + free.floor
    spline = _by_total(clip, free, limit) if local is None else _by_model(clip, free, local, limit)
    if spline is not None:
        return spline
    for frames in FILTERS:  # no spline is near enough: the losses jump, and so would the camera
        x = along(free.x, frames)
        total = clip.total(x)
        if total <= max(limit, free.free + bearable(free.free)):
            return replace(free, x=x, filtered=frames, total=total)
    return free


def _by_total(clip: WholeClip, free: LeastPath, limit: float) -> LeastPath | None:
    """The least order that is good enough, each tried in turn."""
    for knots, way in _ladder(clip, free.x):
        x = fit(free.x, None, knots, way).x
        total = clip.total(x)
        if total <= limit:
            return replace(free, x=x, knots=knots, lens_kept=way is not None or knots == 1, total=total)
    return None


def _by_model(clip: WholeClip, free: LeastPath, local: Local, limit: float) -> LeastPath | None:
    """The least order that is good enough, of those of which the linear model says so.

    One that turns out not to be is tried again from where it led, as long as the model there says so; the next one has
    to promise clearly more.
    """
    left, promised = TRIED, math.inf
    for knots, way in _ladder(clip, free.x):
        spline = fit(free.x, local, knots, way)
        first = spline.predicted
        if not left or first is None or first > min(limit, CLEARLY * promised):
            continue
        while left and spline.predicted is not None and spline.predicted <= limit:
            left -= 1
            residuals = clip.residuals(spline.x)
            total = float(group_norms(residuals, local.groups).sum(1).mean())
            if total <= limit:
                kept = way is not None or knots == 1
                return replace(free, x=spline.x, knots=knots, lens_kept=kept, total=total)
            if total > FAR * limit:  # the model does not hold there
                break
            spline = fit(spline.x, replace(local, residuals=residuals), knots, way)
        promised = first
    return None


def _ladder(clip: WholeClip, x: Tensor) -> list[tuple[int, Tensor | None]]:
    """Knots, and the direction of x that is kept still if any; the least first."""
    lens = clip.lens(x.shape[1])
    return [(knots, way) for knots in orders(len(x)) for way in ([None] if lens is None else [lens, None])]


def _nearer(clip: WholeClip, path: LeastPath, fitted: Fitted) -> LeastPath:
    """The path moved to ``fitted``, or half the way, if that costs less."""
    for x in (fitted.x, (fitted.x + path.x) / 2):
        total = clip.total(x)
        if total < path.total:
            return replace(path, x=x, total=total)
    return path
