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

    Takes as many evaluations of the frames that may go aside as there are ways, and one of all frames.

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
    costs[0] = clip.totals(residuals).numpy()
    for first, last in runs(frames):
        for way, move in enumerate(ways, 1):
            costs[way, first:last] = clip.totals(clip.part(clip.inside(x + move), x, first, last)).numpy()
    sway = SWAY * (moves[:, None] - moves).abs().sum(-1).numpy()
    there = clip.inside(x + along(moves[torch.from_numpy(steadiest(costs, sway))], STEADY))
    found = clip.residuals(there)
    before, after = (clip.mean_total(r) + bending(path, about) for r, path in ((residuals, x), (found, there)))
    return (there, found) if after < before - PROMISE else (x, residuals)


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
