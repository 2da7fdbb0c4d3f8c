"""A whole path in closed form: stands as read, aimed at the reference's joints, at the distances that suit the clip.

Where a camera stands around the person is read off the reference, and where and how large the person appears follows
by projection alone. What is left is the distance at one size. That is looked up for a few frames along the clip and
chosen for all of them together, by dynamic programming, coarsely and then finely: a depth that suits the first frame
best may suit the rest badly, and a search that follows the clip frame by frame cannot come back from there.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..along_clip import along, counted
from ..features import Features
from ..orientation import wrap
from ..placement import frame_joints, visible_joints
from ..search.subject_orbit import SCALE, SubjectOrbit
from ..subject import Subject
from .lookups import STEP, cheapest_along
from .whole_clip import WholeClip

DISTANCES = 0.5 * 1.12 ** (torch.arange(70, dtype=torch.float64) / STEP)  # subject heights, 0.5 to 6.8
BETWEEN, LONGEST = 0.61, 2.0  # that distances are smoothed over: of the frames between two lookups, at most [frames]
SLOPE, LEAD = 3, 12  # frames that tell how the person moved in the frame before, and for how many that is believed
PLACE = slice(4, 6)  # of x: where in the frame the person stands
LEVELLED, LEVEL = 5, 0.05  # times that a path is raised or lowered at most, and by how much [rad] it is enough
AIMED_AT = 2  # joints that tell where and how large the person is to be
BEND = 5.0  # total that the background's flow costs where the log of the distance changes by 1 a frame, suddenly


def closed_form(clip: WholeClip, free_lens: bool, samples: int) -> Tensor | None:
    """The path (N, D) in closed form; None where the search, or what was read of the reference, does not allow one.

    Evaluates about half of ``samples`` times the steps of :data:`DISTANCES`, for a clip of any length; all of them for
    a frame that none of that half suits, or far less than the others, and for a single sample; where none suits, those
    between two steps too.

    Args:
        clip: N frames; its home may be any view of the right size, which lends its lens where that is kept, and
            nothing else.
        free_lens: whether x holds the lens; if not, the distance follows the size and nothing is looked up.
        samples: frames along the clip for which distances are looked up, at least 1; where it is 1 the first
            that shows joints.
    """
    reference = clip.reference
    if not aimable(clip) or not reference.has("orientation"):
        return None
    stands = _stands(reference.require("orientation").double(), counted(len(reference), clip.at))
    if stands is None:
        return None
    x = torch.zeros(len(reference), 7 if free_lens else 6, dtype=torch.float64)  # in the middle, as high as the frame
    x[:, :3] = stands / SCALE[:3]
    if free_lens:
        found = _distances(clip, x, samples)
        if found is None:
            return None
        x[:, 3] = found
    return _as_read(clip, aimed_path(clip, x), stands)


def _as_read(clip: WholeClip, x: Tensor, stands: Tensor) -> Tensor:
    """The path x (N, D) raised or lowered until angles about what is shown are the ``stands`` (N, 3) that were read."""
    steps, subject = clip.stage.plan.steps, clip.stage.scene.subject
    reader = next((step.extractor for step in steps if getattr(step.extractor, "about", "") == "shown"), None)
    if reader is None:
        return x
    for _ in range(LEVELLED):
        cameras = clip.cameras(x)
        read = reader(Features(cameras.size, camera=cameras, person=subject), None).require("orientation")
        off = wrap(stands - read)[:, 1].nan_to_num(0)
        if float(off.abs().max()) < LEVEL:
            break
        raised = x.clone()
        raised[:, 1] += off / SCALE[1]
        x = aimed_path(clip, raised)  # which shows more of the body, or less
    return x


def aimable(clip: WholeClip) -> bool:
    """Whether its search can aim at the joints of the reference, and some frame shows enough of them."""
    known = isinstance(clip.search, SubjectOrbit) and clip.reference.has("keypoints")
    return known and bool(aimed_at(clip.reference, clip.stage.scene.subject).any())


def aimed_path(clip: WholeClip, x: Tensor) -> Tensor:
    """The path x (N, D) with every frame aimed at the reference's joints, those without any bridged; one has some."""
    at, subject, aim = counted(len(x), clip.at), clip.stage.scene.subject, clip.search.aimed
    aimed = torch.cat([aim(x[i : i + 1], clip.home, subject, clip.reference[i]) for i in range(len(x))])
    known = aimed_at(clip.reference, subject)
    aimed[:, 3:] = _bridged(aimed[:, 3:], known, at)
    aimed[:, PLACE] = _led(aimed[:, PLACE], known, at)
    return aimed


def aimed_at(reference: Features, subject: Subject | None) -> Tensor:
    """Frames (N,) bool that show enough joints to aim at, of those that the scene's person has."""
    shown = visible_joints(frame_joints(reference, "all"))
    return (shown if subject is None else shown & (subject.confidence > 0)).sum(1) >= AIMED_AT


def _bridged(x: Tensor, known: Tensor, at: Tensor) -> Tensor:
    """x (N, D) with the frames that are not ``known``, (N,) bool, taken from those around them."""
    there, stands = at[known].numpy(), at.numpy()
    return torch.from_numpy(np.stack([np.interp(stands, there, column) for column in x[known].numpy().T], axis=1))


def _led(x: Tensor, known: Tensor, at: Tensor) -> Tensor:
    """Places x (N, D) of all frames, those before any is ``known`` led back: who enters was outside before."""
    seen = known.nonzero()[:, 0].tolist()
    if not seen or seen[0] == 0 or len(seen) == 1:
        return x
    first, then = seen[0], seen[min(SLOPE, len(seen) - 1)]
    early = (at[:first] - at[first]).clamp_min(-LEAD).to(x.dtype)[:, None]
    led = x.clone()
    led[:first] += early * (x[then] - x[first]) / (at[then] - at[first]).to(x.dtype)
    return led


def _stands(read: Tensor, at: Tensor) -> Tensor | None:
    """Azimuth, elevation and roll (N, 3) [rad] as read, without turns; None where no frame was read."""
    known = torch.isfinite(read).all(1)
    if not bool(known.any()):
        return None
    turning = read.clone()
    turning[known] = torch.from_numpy(np.unwrap(read[known].numpy(), axis=0))
    return _bridged(turning, known, at)


def _distances(clip: WholeClip, x: Tensor, samples: int) -> Tensor | None:
    """Distances (N,) in the units of x that cost least along the clip; None where no frame is seen from any."""
    reference, at = clip.reference, counted(len(x), clip.at)
    frames, told = _spread(len(reference), samples), aimed_at(reference, clip.stage.scene.subject).numpy()
    if samples == 1 or not told[frames].any():  # among those that tell
        frames = np.flatnonzero(told)[_spread(int(told.sum()), samples)]
    logs, seen = DISTANCES.log(), False

    def look_up(k: int, tried: NDArray) -> NDArray:
        nonlocal seen
        costs, found = _costs(clip, int(frames[k]), x[int(frames[k])], logs[tried])
        seen |= found
        return costs

    chosen = cheapest_along(look_up, len(frames), logs.numpy(), BEND * len(frames) / len(reference))
    if not seen:
        return None
    between = torch.from_numpy(np.interp(at.numpy(), at.numpy()[frames], logs.numpy()[chosen]))
    if len(frames) == 1:
        return between / SCALE[3]
    apart = (len(reference) - 1) / (len(frames) - 1)
    return along(between[:, None], min(BETWEEN * apart, LONGEST), at)[:, 0] / SCALE[3]


def _spread(frames: int, samples: int) -> NDArray:
    """The first of N frames and the last, and others evenly between, as many as there are ``samples``."""
    return np.unique(np.linspace(0, frames - 1, samples).round().astype(int))


def _costs(clip: WholeClip, frame: int, x: Tensor, logs: Tensor) -> tuple[NDArray, bool]:
    """What the losses that need no flow give for one frame, from x (D,) at distances ``logs`` (K,), and if any does."""
    wanted, objective = clip.reference[frame], clip.stage.objective
    still = ~objective.of_motion
    tried = x.repeat(len(logs), 1)
    tried[:, 3] = logs / SCALE[3]
    tried = clip.search.aimed(tried, clip.home, clip.stage.scene.subject, wanted)
    terms = clip.stage.terms(wanted, clip.cameras(tried), None)
    defined = clip.defined[frame] & still
    weighted = objective.weighted(terms, defined)[:, still].sum(1).numpy()
    return weighted, bool(torch.isfinite(terms[:, defined]).any())
