"""Along the clip: one minimisation a frame, started from the frames before it or from the initial view."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..camera import Camera, concatenate
from ..features import Features
from .cma_es import Budget, Minimum, Start, minimise
from .stage import Stage


@dataclass(frozen=True)
class Schedule:
    """How frames are started.

    Args:
        budget: of each frame.
        sigma: first step size from the initial view, as a share of the half-range.
        warm_sigma: the same from the frames before.
        warm: start from the frames before; otherwise every frame starts from the initial view.
        free_lens: whether the focal length moves.
        seed: of the run.
    """

    budget: Budget
    sigma: float
    warm_sigma: float
    warm: bool
    free_lens: bool
    seed: int


@dataclass(frozen=True)
class Path:
    """What was found.

    Args:
        x: (N, D) vectors of the search.
        camera: N cameras.
        frames: the minimum of each frame.
    """

    x: Tensor  # (N, D)
    camera: Camera
    frames: tuple[Minimum, ...]


def follow(
    stage: Stage,
    search: Any,
    reference: Features,
    home: Camera,
    schedule: Schedule,
    progress: Callable[[int, Minimum], None] = lambda frame, found: None,
) -> Path:
    """Find a camera for every frame of ``reference``, in order.

    Sequential because flow spans a frame and the one before (paper Sec. 9). A warm frame starts where the last ones
    lead, and with the covariance the last one learned: neighbours have nearly the same landscape. Each frame has its
    own random numbers, derived from the seed and its index.

    Args:
        stage: renders and scores candidates.
        search: vectors to cameras.
        reference: N frames.
        home: the initial view, at the size that is searched.
        schedule: budgets and starts.
        progress: called after each frame.
    """
    subject = stage.scene.subject
    low, high = search.bounds()
    D = search.dimensions if schedule.free_lens else search.dimensions - 1
    at_home = search.vector(home, home, subject)[0, :D]
    defined = stage.objective.defined(reference)
    xs: list[Tensor] = []
    found: list[Minimum] = []
    before: Features | None = None

    for i in range(len(reference)):

        def totals(x: Tensor, i: int = i, before: Features | None = before, stage: Stage = stage) -> Tensor:
            cameras = search.cameras(x, home, subject)
            return stage.objective.totals(stage.terms(reference[i], cameras, before), defined[i])

        if schedule.warm and i > 0:
            starts = _predictions(xs)
            if hasattr(search, "aimed"):
                starts = torch.cat([starts, search.aimed(starts, home, subject, reference[i])])
            best = starts[int(totals(starts).argmin())]
            start = Start(best, schedule.warm_sigma, found[-1].shape)
        else:
            start = Start(at_home, schedule.sigma)
        generator = np.random.Generator(np.random.PCG64([schedule.seed, i]))
        minimum = minimise(totals, start, (low[:D], high[:D]), schedule.budget, generator)
        stage.spent.generations += minimum.generations
        xs.append(minimum.x)
        found.append(minimum)
        camera = search.cameras(minimum.x[None], home, subject)
        stage = stage.about(camera)
        before = stage.features(camera, before)
        progress(i, minimum)
    x = torch.stack(xs)
    return Path(x, search.cameras(x, home, subject), tuple(found))


def _predictions(xs: list[Tensor]) -> Tensor:
    """The last frame, and the last motion continued, (1 or 2, D)."""
    if len(xs) < 2:
        return xs[-1][None]
    return torch.stack([xs[-1], 2 * xs[-1] - xs[-2]])


def smoothed(x: Tensor, frames: float) -> Tensor:
    """x (N, D) filtered along the clip by a Gaussian of standard deviation ``frames``.

    The ends are continued by point reflection, so that a steady motion stays what it is.
    """
    if frames <= 0 or len(x) < 3:
        return x
    radius = min(int(3 * frames + 0.5), len(x) - 1)
    offsets = torch.arange(-radius, radius + 1, dtype=x.dtype)
    kernel = torch.exp(-0.5 * (offsets / frames) ** 2)
    kernel = kernel / kernel.sum()
    head = 2 * x[:1] - x[1 : radius + 1].flip(0)
    tail = 2 * x[-1:] - x[-radius - 1 : -1].flip(0)
    windows = torch.cat([head, x, tail]).unfold(0, 2 * radius + 1, 1)  # (N, D, 2 radius + 1)
    return windows @ kernel


def still(camera: Camera, count: int) -> Camera:
    """The first camera held for ``count`` frames: what a transfer has to beat."""
    return concatenate([camera[0]] * count)
