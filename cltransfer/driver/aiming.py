"""Cameras aimed at a reference: where and as large as it shows the person, and from as high as it was read.

Where angles are about what a frame shows of the person, how high a camera stands to be read so depends on how much of
them it shows, and that on how far away it is: it is raised or lowered where it stands.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ..along_clip import counted
from ..extractors.scene_orientation import SceneOrientation
from ..features import Features
from ..orientation import wrap
from ..placement import frame_joints, visible_joints
from ..search.subject_orbit import DISTANCE, ELEVATION, PLACE, SCALE, SubjectOrbit
from ..subject import Subject
from .whole_clip import WholeClip

SLOPE, LEAD = 3, 12  # frames that tell how the person moved in the frame before, and for how many that is believed
AIMED_AT = 2  # joints that tell where and how large the person is to be
LEVELLED, LEVEL = 12, 0.02  # times that a camera is raised or lowered at most, and by how much [rad] it is enough


def aimable(clip: WholeClip) -> bool:
    """Whether its search can aim at the joints of the reference, and some frame shows enough of them."""
    known = isinstance(clip.search, SubjectOrbit) and clip.reference.has("keypoints")
    return known and bool(aimed_at(clip.reference, clip.stage.scene.subject).any())


def aimed_at(reference: Features, subject: Subject | None) -> Tensor:
    """Frames (N,) bool that show enough joints to aim at, of those that the scene's person has."""
    shown = visible_joints(frame_joints(reference, "all"))
    return (shown if subject is None else shown & (subject.confidence > 0)).sum(1) >= AIMED_AT


def aimed(clip: WholeClip, x: Tensor, reference: Features, pitch: Tensor) -> Tensor:
    """The x (B, D) aimed at ``reference``, B frames or one, from as high as ``pitch`` (B,) [rad] is read from there.

    Only where the losses' angles are about what is shown; about the body every camera is read as it stands. From where
    none is read so, it stands where it is read next to it.
    """
    subject = clip.stage.scene.subject
    x = clip.search.aimed(x, clip.home, subject, reference)
    if _reader(clip) is None:
        return x
    lowest, highest = (bound[ELEVATION] for bound in clip.search.bounds())
    too_low, too_high = torch.full_like(pitch, torch.nan), torch.full_like(pitch, torch.nan)  # (B,) of x
    best, least = x, torch.full_like(pitch, torch.inf)
    for _ in range(LEVELLED):
        off = wrap(pitch - pitch_of(clip, x))  # (B,), NaN where nothing is seen
        nearer = off.abs() < least
        best, least = torch.where(nearer[:, None], x, best), torch.where(nearer, off.abs(), least)
        if not (least >= LEVEL).any():
            break
        height = x[:, ELEVATION]
        too_low, too_high = torch.where(off > 0, height, too_low), torch.where(off < 0, height, too_high)
        between = (too_low + too_high) / 2  # what is shown changes on the way: one step may lead far beyond
        raised = torch.where(between.isnan(), height + off.nan_to_num(0) / SCALE[ELEVATION], between)
        x = x.clone()
        x[:, ELEVATION] = raised.clamp(lowest, highest)
        x = clip.search.aimed(x, clip.home, subject, reference)
    return best


def pitch_of(clip: WholeClip, x: Tensor) -> Tensor:
    """Pitch (B,) [rad] as the losses' angles have it of the cameras of x (B, D); NaN where they show nobody."""
    reader, cameras = _reader(clip), clip.cameras(x)
    if reader is None:
        return x[:, ELEVATION] * SCALE[ELEVATION]
    seen = Features(cameras.size, camera=cameras, person=clip.stage.scene.subject)
    return reader(seen, None).require("orientation")[:, 1]


def _reader(clip: WholeClip) -> SceneOrientation | None:
    """What reads angles about what is shown of the person; None where they are about the body."""
    extractors = (step.extractor for step in clip.stage.plan.steps)
    return next((one for one in extractors if isinstance(one, SceneOrientation) and one.about == "shown"), None)


def aimed_path(clip: WholeClip, x: Tensor, pitch: Tensor) -> Tensor:
    """The path x (N, D) with every frame :func:`aimed`, those without joints bridged; one has some.

    Args:
        clip: N frames.
        x: where it stands.
        pitch: of the cameras as the reference was read, (N,) [rad].
    """
    at, subject = counted(len(x), clip.at), clip.stage.scene.subject
    path = aimed(clip, x, clip.reference, pitch)
    known = aimed_at(clip.reference, subject)
    raised = (path[:, ELEVATION] - x[:, ELEVATION])[:, None]
    path[:, ELEVATION] = x[:, ELEVATION] + _bridged(raised, known, at)[:, 0]
    path[:, DISTANCE:] = _bridged(path[:, DISTANCE:], known, at)
    path[:, PLACE] = _led(path[:, PLACE], known, at)
    return path


def stands(clip: WholeClip) -> Tensor | None:
    """Azimuth, elevation and roll (N, 3) [rad] as read of the reference, without turns; None where no frame was."""
    if not clip.reference.has("orientation"):
        return None
    return _unturned(clip.reference.require("orientation").double(), counted(len(clip.reference), clip.at))


def _unturned(read: Tensor, at: Tensor) -> Tensor | None:
    """Angles (N, 3) [rad] without turns, those that are NaN bridged; None where all are."""
    known = torch.isfinite(read).all(1)
    if not bool(known.any()):
        return None
    turning = read.clone()
    turning[known] = torch.from_numpy(np.unwrap(read[known].numpy(), axis=0))
    return _bridged(turning, known, at)


def _bridged(x: Tensor, known: Tensor, at: Tensor) -> Tensor:
    """x (N, D) with the frames that are not ``known``, (N,) bool, taken from those around them."""
    there, places = at[known].numpy(), at.numpy()
    return torch.from_numpy(np.stack([np.interp(places, there, column) for column in x[known].numpy().T], axis=1))


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
