"""A path that goes aside for some of its frames, past what stands before the person there, or where a loss jumps.

Least squares follow slopes, and a leaf that hides the person has none; nor has a layer's depth, a mode, where another
peak gets the higher one. So the whole path is tried a little aside, every way, at those frames; which of the ways
each frame takes is chosen for all of them together, by dynamic programming; and it is taken where it costs less.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..along_clip import along, runs
from .joint import PROMISE
from .spline import bending
from .whole_clip import WholeClip

BESIDE = 2  # frames on either side that may go aside too
STEADY = 1.5  # [frames] over which a path does


@dataclass(frozen=True)
class Tries:
    """How much is tried.

    Args:
        every: frames of which one is tried: the others gain what those around them do.
        sways: totals of one frame that the background's flow may cost where a path goes aside by 1, in the units of x;
            what is best by each is scored.
        stands: whether views nearby are tried too, with other lenses, as of a camera that stands.
    """

    every: int
    sways: tuple[float, ...]
    stands: bool = False

    @property
    def whole(self) -> bool:
        """Whether all frames go the same way, or none does."""
        return min(self.sways) == math.inf


FEW, MANY = Tries(2, (9.0,)), Tries(1, (9.0, 4.0))


def as_a_whole(every: int, stands: bool = False) -> Tries:
    """Of a path that stays what it is, static or linear: all frames go the same way, or none does."""
    return Tries(every, (math.inf,), stands)


def go_aside(
    clip: WholeClip,
    x: Tensor,
    residuals: Tensor,
    wanted: Tensor,
    about: Tensor | None = None,
    lens_kept: bool = False,
    tries: Tries = FEW,
) -> tuple[Tensor, Tensor]:
    """The path aside where that costs less, else as it is, and its residuals.

    Takes as many evaluations of each frame that is tried as there are ways, one of all frames for each path aside.

    Args:
        clip: what it is a path for; every loss has residuals, and the search has ways aside.
        x: the path, (N, D).
        residuals: of it, (N, R).
        wanted: frames that should go aside, (N,) bool; those beside them may too.
        about: path (N, D) whose own bends cost nothing, because the reference makes them; None is a straight one.
        lens_kept: whether the focal length is to stay as it is.
        tries: how much is tried.
    """
    from scipy.ndimage import binary_dilation

    ways = clip.aside(x.shape[1], lens_kept, tries.stands)
    if ways is None or not bool(wanted.any()):
        return x, residuals
    frames = torch.from_numpy(binary_dilation(wanted.numpy(), iterations=BESIDE))
    if tries.whole:
        frames |= ~clip.placed  # wherever they stand, and they keep none of the others back
    moves = torch.cat([torch.zeros_like(ways[:1]), ways])  # (W, D), the first is none
    costs = np.full((len(moves), len(x)), np.inf)
    costs[0] = 0.0
    for first, last in runs(frames):
        tried = [i for i in range(first, last) if bool(clip.placed[i])][:: tries.every]
        if not tried:
            costs[1:, first:last] = 0.0  # wherever it stands
            continue
        lost = np.stack([_lost(clip, x[i] + ways, residuals[i], i) for i in tried], axis=1)  # (W, T)
        costs[1:, first:last] = [np.interp(range(first, last), tried, cost) for cost in lost]
    change = (moves[:, None] - moves).abs().sum(-1).numpy()
    chosen = {tuple(steadiest(costs, np.where(change > 0, sway, 0.0) * change).tolist()) for sway in tries.sways}
    best, least = (x, residuals), clip.mean_total(residuals) + bending(x, about, clip.at) - PROMISE
    for way in sorted(way for way in chosen if any(way)):
        # one that goes as a whole stays what it is, to the last bit: a camera that stands shows two views
        move = moves[way[0]] if len(set(way)) == 1 else along(moves[list(way)], STEADY, clip.at)
        there = clip.inside(x + move, clip.lens(x.shape[1]) if lens_kept else None)
        found = clip.residuals(there)
        total = clip.mean_total(found) + bending(there, about, clip.at)
        if total < least:
            best, least = (there, found), total
    return best


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
