"""Whether the person lies, or leans far, in the scene and not in the reference, or the other way round."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..features import Features
from ..orientation import wrap
from ..skeleton import JOINTS, VISIBLE
from ..subject import Subject

FAR = math.radians(45)  # from upright, beyond which a trunk leans far; and the pitch up to which an image tells that
# [shoulder widths]: where a trunk is longer on one side and shorter on the other, it leans otherwise
LONG, SHORT = 1.0, 0.7


def lean_note(person: Subject | None, reference: Features) -> str:
    """What a reader should know where a trunk leans far on one side alone; empty where not, or where a side is untold.

    The size is compared along that side of the frame which the reference's body spans most.
    """
    if person is None or not (reference.has("keypoints") and reference.has("orientation")):
        return ""
    lean, told = trunk_lean(person), _told(reference)
    if math.isnan(lean) or not bool(told.any()):
        return ""
    here, there = lean > FAR, _image_lean(_image(reference)[0]).abs() > FAR
    if not bool((told & (there != here) & _otherwise(person, reference)).sum() > told.sum() / 2):
        return ""
    than = f"by {'less' if here else 'more'} than {math.degrees(FAR):.0f} in the reference"
    told_of = f"the person's trunk leans by {math.degrees(lean):.0f} degrees in the scene, {than}"
    return f"{told_of}: their size is compared along the longer side of the reference's body, and may be far off"


def trunk_lean(person: Subject) -> float:
    """Angle from upright of the way from the hips to the neck [rad]; NaN where they are not known."""
    along = torch.nn.functional.normalize(_body(person)[0], dim=0) @ person.up
    return float(torch.acos(along.clamp(-1, 1)))


def _told(seen: Features) -> Tensor:
    """Frames (N,) bool whose image tells how the trunk leans: by a camera neither rolled so far nor so steep."""
    names = ("neck", "left_hip", "right_hip", "left_shoulder", "right_shoulder")
    sure = seen.require("keypoints")[:, [JOINTS.index(name) for name in names], 2] > VISIBLE
    _, pitch, roll = seen.require("orientation").double().unbind(1)
    lean = _image_lean(_image(seen)[0])
    rolled = (lean.abs() > FAR) != (wrap(lean - roll).abs() > FAR)
    return sure.all(1) & (pitch.abs() < FAR) & ~rolled


def _otherwise(person: Subject, seen: Features) -> Tensor:
    """Frames (N,) bool that the person of a scene would not look like from where they were seen: by their trunk."""
    trunk, shoulders = _image(seen)
    angles = seen.require("orientation").double()
    trunk_here, shoulders_here = (_looked_at(person, part, angles) for part in _body(person))
    long, long_here = trunk.norm(dim=1) / shoulders.norm(dim=1), trunk_here.norm(dim=1) / shoulders_here.norm(dim=1)
    turned = wrap(_image_lean(trunk_here) - _image_lean(trunk)).abs() > FAR
    return turned | ((long > LONG) & (long_here < SHORT)) | ((long < SHORT) & (long_here > LONG))


def _looked_at(person: Subject, part: Tensor, angles: Tensor) -> Tensor:
    """A way (3,) in the scene as x and y (N, 2), in its units, from yaw, pitch and roll (N, 3) and from far away."""
    yaw, pitch, roll = angles[..., None].unbind(1)  # (N, 1) each
    level = yaw.cos() * person.facing + yaw.sin() * person.left
    right = yaw.cos() * person.left - yaw.sin() * person.facing
    up = pitch.cos() * person.up - pitch.sin() * level
    x, y = right @ part, -(up @ part)
    turn = roll[:, 0]
    return torch.stack([turn.cos() * x - turn.sin() * y, turn.sin() * x + turn.cos() * y], dim=1)


def _body(person: Subject) -> tuple[Tensor, Tensor]:
    """From the hips to the neck and from shoulder to shoulder, (3,) each; NaN where not known."""
    return _parts(person.joints.masked_fill(person.confidence[:, None] <= 0, torch.nan))


def _image(seen: Features) -> tuple[Tensor, Tensor]:
    """The same in an image, (N, 2) each [px]."""
    return _parts(seen.require("keypoints").double()[..., :2])


def _parts(joints: Tensor) -> tuple[Tensor, Tensor]:
    at = dict(zip(JOINTS, joints.unbind(-2)))
    return at["neck"] - (at["left_hip"] + at["right_hip"]) / 2, at["left_shoulder"] - at["right_shoulder"]


def _image_lean(trunk: Tensor) -> Tensor:
    """Angles (N,) [rad] to the right of upright, of ways (N, 2) in an image."""
    return torch.atan2(trunk[:, 0], -trunk[:, 1])
