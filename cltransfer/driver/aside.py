"""A path that goes aside for some of its frames, past what stands before the person there.

Least squares follow slopes, and a leaf that hides the person has none. So the whole path is tried a little aside, every
way, at those frames; which of the ways each frame takes is chosen for all of them together, by dynamic programming; and
it is taken where it costs less.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..reading.tracks import along, runs
from .joint import PROMISE
from .spline import bending
from .whole_clip import WholeClip

BESIDE = 2  # frames on either side that may go aside too
EVERY = 2  # frames of which one is tried: the others gain what those around them do
SWAY = 9.0  # total of one frame that the background's flow costs where a path goes aside by 1, in the units of x
STEADY = 1.5  # [frames] over which it does


def go_aside(
    clip: WholeClip,
    x: Tensor,
    residuals: Tensor,
    wanted: Tensor,
    about: Tensor | None = None,
    lens_kept: bool = False,
) -> tuple[Tensor, Tensor]:
    """The path aside where that costs less, else as it is, and its residuals.

    Takes as many evaluations of every :data:`EVERY`-th frame that may go aside as there are ways, one of all frames.

    Args:
        clip: what it is a path for; every loss has residuals, and the search has ways aside.
        x: the path, (N, D).
        residuals: of it, (N, R).
        wanted: frames that should go aside, (N,) bool.
        about: path (N, D) whose own bends cost nothing, because the reference makes them; None is a straight one.
        lens_kept: whether the focal length is to stay as it is.
    """
    from scipy.ndimage import binary_dilation

    ways = clip.aside(x.shape[1], lens_kept)
    if ways is None or not bool(wanted.any()):
        return x, residuals
    frames = torch.from_numpy(binary_dilation(wanted.numpy(), iterations=BESIDE))
    moves = torch.cat([torch.zeros_like(ways[:1]), ways])  # (W, D), the first is none
    costs = np.full((len(moves), len(x)), np.inf)
    costs[0] = 0.0
    for first, last in runs(frames):
        tried = range(first, last, EVERY)
        lost = np.stack([_lost(clip, x[i] + ways, residuals[i], i) for i in tried], axis=1)  # (W, T)
        costs[1:, first:last] = [np.interp(range(first, last), tried, cost) for cost in lost]
    sway = SWAY * (moves[:, None] - moves).abs().sum(-1).numpy()
    there = clip.inside(x + along(moves[torch.from_numpy(steadiest(costs, sway))], STEADY, clip.at))
    found = clip.residuals(there)
    before, after = (clip.mean_total(r) + bending(path, about, clip.at) for r, path in ((residuals, x), (found, there)))
    return (there, found) if after < before - PROMISE else (x, residuals)


def _lost(clip: WholeClip, x: Tensor, residuals: Tensor, frame: int) -> NDArray:
    """How much more x (W, D) cost that frame than the path does, of ``residuals`` (R,): (W,), but for motion."""
    still = ~clip.stage.objective.of_motion
    there = clip.still_totals(clip.inside(x), frame)
    return (there - clip.totals(residuals[None] * clip.stage.objective.rows(still))).numpy()


def steadiest(costs: NDArray, change: NDArray) -> NDArray:
    """Which of W ways each of N frames takes, (N,), so that costs (W, N) and what changes (W, W) cost are least in sum.

    >>> steadiest(np.array([[0.0, 3.0, 0.0], [9.0, 0.0, 9.0]]), np.array([[0.0, 1.0], [1.0, 0.0]])).tolist()
    [0, 1, 0]
    """
    best, back = costs[:, 0], []
    for cost in costs.T[1:]:
        reached = best[:, None] + change  # (W, W), from the first to the second
        back.append(reached.argmin(0))
        best = reached.min(0) + cost
    taken = [int(best.argmin())]
    for step in reversed(back):
        taken.append(int(step[taken[-1]]))
    return np.array(taken[::-1])
