"""A whole path in closed form: stands as read, aimed at the reference's joints, at the distances that suit the clip.

Where a camera stands around the person is read off the reference, and where and how large the person appears follows
by projection alone. What is left is the distance at one size. That is looked up for a few frames along the clip and
chosen for all of them together, by dynamic programming, coarsely and then finely: a depth that suits the first frame
best may suit the rest badly, and a search that follows the clip frame by frame cannot come back from there. Where no
distance suits, what stands before and behind the person there does not: the whole path is tried from aside too.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..along_clip import along, counted
from ..search.subject_orbit import SCALE
from .aiming import aimable, aimed, aimed_at, aimed_path, stands
from .lookups import POOR, STEP, cheapest_along
from .whole_clip import WholeClip

DISTANCES = 0.5 * 1.12 ** (torch.arange(70, dtype=torch.float64) / STEP)  # subject heights, 0.5 to 6.8
BETWEEN, LONGEST = 0.61, 2.0  # that distances are smoothed over: of the frames between two lookups, at most [frames]
SIDES = ((0, 0.25), (0, -0.25), (1, 0.25), (1, -0.25))  # azimuth and elevation [rad]: five tolerances of the angle
GAINS = 0.5  # total of a frame that another side has to gain
BEND = 5.0  # total that the background's flow costs where the log of the distance changes by 1 a frame, suddenly


def closed_form(clip: WholeClip, free_lens: bool, samples: int) -> Tensor | None:
    """The path (N, D) in closed form; None where the search, or what was read of the reference, does not allow one.

    Evaluates about half of ``samples`` times the steps of :data:`DISTANCES`, for a clip of any length; all of them for
    a frame that none of that half suits, or far less than the others, and for a single sample; where none suits, those
    between two steps too. Where the frames that are looked up cost more than :data:`.lookups.POOR` in the mean,
    as often again from each of :data:`SIDES`.

    Args:
        clip: N frames; its home may be any view of the right size, which lends its lens where that is kept, and
            nothing else.
        free_lens: whether x holds the lens; if not, the distance follows the size and nothing is looked up.
        samples: frames along the clip for which distances are looked up, at least 1; where it is 1 the first
            that shows joints.
    """
    reference = clip.reference
    if not aimable(clip) or (read := stands(clip)) is None:
        return None
    x = torch.zeros(len(reference), 7 if free_lens else 6, dtype=torch.float64)  # in the middle, as high as the frame
    x[:, :3] = read / SCALE[:3]
    if free_lens:
        found = _best_side(clip, x, samples, read[:, 1])
        return None if found is None else aimed_path(clip, *found)
    return aimed_path(clip, x, read[:, 1])


def _best_side(clip: WholeClip, x: Tensor, samples: int, pitch: Tensor) -> tuple[Tensor, Tensor] | None:
    """The path x (N, 7) at distances that suit it and its ``pitch`` (N,) [rad], or both from aside if none suits here.

    None where no frame is seen from any distance.
    """
    first = _distances(clip, x, samples, pitch)
    if first is None:
        return None
    best, least = (first[0], pitch), first[1]
    if least > POOR:
        least -= GAINS
        for axis, by in SIDES:
            beside = x.clone()
            beside[:, axis] += by / SCALE[axis]
            higher = pitch + by if axis == 1 else pitch
            found = _distances(clip, clip.inside(beside), samples, higher)
            if found is not None and found[1] < least:
                best, least = (found[0], higher), found[1]
    return best


def _distances(clip: WholeClip, x: Tensor, samples: int, pitch: Tensor) -> tuple[Tensor, float] | None:
    """The path x (N, 7) at the distances that cost least along the clip, and what the frames looked up cost there.

    None where no frame is seen from any distance.

    Args:
        clip: N frames.
        x: where the cameras stand, (N, D).
        samples: frames for which distances are looked up.
        pitch: as the reference was read, (N,) [rad].
    """
    reference, at = clip.reference, counted(len(x), clip.at)
    frames, told = _spread(len(reference), samples), aimed_at(reference, clip.stage.scene.subject).numpy()
    if samples == 1 or not told[frames].any():  # among those that tell
        frames = np.flatnonzero(told)[_spread(int(told.sum()), samples)]
    logs, seen = DISTANCES.log(), False
    known = np.full((len(frames), len(logs)), np.inf)

    def look_up(k: int, tried: NDArray) -> NDArray:
        nonlocal seen
        frame = int(frames[k])
        known[k, tried], found = _costs(clip, frame, x[frame], logs[tried], pitch[frame])
        seen |= found
        return known[k, tried]

    chosen = cheapest_along(look_up, len(frames), logs.numpy(), BEND * len(frames) / len(reference))
    if not seen:
        return None
    between = torch.from_numpy(np.interp(at.numpy(), at.numpy()[frames], logs.numpy()[chosen]))
    if len(frames) > 1:
        apart = (len(reference) - 1) / (len(frames) - 1)
        between = along(between[:, None], min(BETWEEN * apart, LONGEST), at)[:, 0]
    path = x.clone()
    path[:, 3] = between / SCALE[3]
    return path, float(known[np.arange(len(frames)), chosen].mean())


def _spread(frames: int, samples: int) -> NDArray:
    """The first of N frames and the last, and others evenly between, as many as there are ``samples``."""
    return np.unique(np.linspace(0, frames - 1, samples).round().astype(int))


def _costs(clip: WholeClip, frame: int, x: Tensor, logs: Tensor, pitch: Tensor) -> tuple[NDArray, bool]:
    """What the losses that need no flow give for one frame, from x (D,) at distances ``logs`` (K,), and if any does.

    Each is aimed, and as high as ``pitch`` () [rad] is read from there.
    """
    wanted, objective = clip.reference[frame], clip.stage.objective
    still = ~objective.of_motion
    tried = x.repeat(len(logs), 1)
    tried[:, 3] = logs / SCALE[3]
    tried = aimed(clip, tried, wanted, pitch.expand(len(logs)))
    terms = clip.stage.terms(wanted, clip.cameras(tried), None)
    defined = clip.defined[frame] & still
    weighted = objective.weighted(terms, defined)[:, still].sum(1).numpy()
    return weighted, bool(torch.isfinite(terms[:, defined]).any())
