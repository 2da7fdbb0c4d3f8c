"""Along the clip: one search a frame, started from the frames before it or from the initial view."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..camera import Camera, concatenate
from ..features import Features
from .frame import Memory, Problem, Schedule, Solved, predictions, solve
from .stage import Stage

SMOOTH_WORTH = 1.25  # a filtered path may cost this much more total loss, and a tenth of a tolerance


@dataclass(frozen=True)
class Path:
    """What was found.

    Args:
        x: (N, D) vectors of the search.
        camera: N cameras.
        frames: what was found for each frame.
    """

    x: Tensor  # (N, D)
    camera: Camera
    frames: tuple[Solved, ...]


def follow(
    stage: Stage,
    search: Any,
    reference: Features,
    homes: Camera,
    schedule: Schedule,
    progress: Callable[[int, Solved], None] = lambda frame, found: None,
) -> Path:
    """Find a camera for every frame of ``reference``, in order.

    Sequential because flow spans a frame and the one before (paper Sec. 9). A warm frame starts where the last ones
    lead or where the reference's joints aim it, and with what the last one learned of the landscape: neighbours have
    nearly the same. Each frame has its own random numbers, derived from the seed and its index.

    Args:
        stage: renders and scores candidates.
        search: vectors to cameras.
        reference: N frames.
        homes: initial views, the best first; the first frame starts from the best of them.
        schedule: engine, budgets and starts.
        progress: called after each frame.
    """
    home, subject = homes[0], stage.scene.subject
    defined = stage.objective.defined(reference)
    D = search.dimensions if schedule.free_lens else search.dimensions - 1
    at_home = search.vector(homes, home, subject)[:, :D]
    found: list[Solved] = []
    before: Features | None = None
    memory = Memory()
    for i in range(len(reference)):
        problem = Problem(stage, search, home, reference[i], before, defined[i], schedule.free_lens)
        starts = at_home
        if schedule.warm and i > 0:
            starts = predictions([solved.x for solved in found])
            starts = torch.cat([starts, problem.aimed(starts[-1:])])
        generator = np.random.Generator(np.random.PCG64([schedule.seed, i]))
        solved = solve(problem, starts, memory, schedule, generator)
        stage.spent.generations += solved.generations
        memory = solved.memory
        found.append(solved)
        camera = problem.cameras(solved.x[None])
        stage = stage.about(camera)
        before = stage.features(camera, before)
        progress(i, solved)
    x = torch.stack([solved.x for solved in found])
    return Path(x, search.cameras(x, home, subject), tuple(found))


def smoothed(x: Tensor, frames: float) -> Tensor:
    """The vectors (N, D) filtered along the clip by a Gaussian of standard deviation ``frames``.

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


def filtered(
    stage: Stage, search: Any, reference: Features, home: Camera, found: Path, frames: float
) -> tuple[Camera, str]:
    """The smoothed path and "smooth" where it costs little more than the one found, else that one and "exact"."""
    if frames <= 0:
        return found.camera, "exact"
    cameras = search.cameras(smoothed(found.x, frames), home, stage.scene.subject)
    defined = stage.objective.defined(reference)
    exact, smooth = (
        float(stage.objective.totals(stage.path_terms(reference, path), defined).mean())
        for path in (found.camera, cameras)
    )
    return (cameras, "smooth") if smooth <= SMOOTH_WORTH * exact + 0.1 else (found.camera, "exact")


def still(camera: Camera, count: int) -> Camera:
    """The first camera held for ``count`` frames: what a transfer has to beat."""
    return concatenate([camera[0]] * count)
