"""From which side the camera sees the lifted person."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import torch
from torch import Tensor

from ..camera import Camera
from ..features import Features
from ..orientation import orientation_from_axes
from ..registry import EXTRACTORS
from ..subject import Subject

BETWEEN = 8  # places from a key joint to the next that are looked for in the frame
EDGE = 0.1  # beyond the frame by this part of its height a place counts half


@EXTRACTORS.register("scene_orientation")
@dataclass(frozen=True)
class SceneOrientation:
    """Yaw, pitch and roll of the camera about the person; NaN where what that is about is behind the camera.

    Args:
        about: the middle of the ``body``, the person's anchor, or of what is ``shown`` of it, which is the same where
            the frame holds all of it. Networks see no more of a close-up than the face, and call it level where the
            camera is as high as that, though it looks down on the body's middle by 50 degrees. ``auto`` is the body,
            but what is shown in ``describe`` and in a transfer from a reference that networks have read.
    """

    requires: ClassVar[tuple[str, ...]] = ("camera", "person")
    provides: ClassVar[tuple[str, ...]] = ("orientation",)
    family: ClassVar[Literal["image", "scene", "both"]] = "scene"
    about: Literal["auto", "body", "shown"] = "auto"

    def __call__(self, now: Features, before: Features | None) -> Features:
        """``now`` with ``orientation``."""
        camera, person = now.require("camera"), now.require("person")
        axes = torch.stack([person.left, person.up]).to(camera.w2c) @ camera.w2c[:, :3, :3].transpose(1, 2)
        middle = camera.to_camera(person.anchor[None])[:, 0]  # (B, 3)
        if self.about == "shown":
            middle = middle + _off_middle(camera, person)
        orientation = orientation_from_axes(axes[:, 0], axes[:, 1], -middle)
        return replace(now, orientation=orientation.masked_fill(middle[:, 2:] <= 0, float("nan")))


def _off_middle(camera: Camera, person: Subject) -> Tensor:
    """From the middle of the body to that of what is shown of it, (B, 3) in camera axes; smooth in the camera."""
    joints = person.key_joints[person.key_joints[:, 3] > 0, :3]
    if not bool((joints != joints[0]).any()):  # a single place is the middle of whatever is shown
        return torch.zeros(len(camera), 3, dtype=joints.dtype)
    part = torch.arange(BETWEEN, dtype=joints.dtype)[:, None] / BETWEEN
    chain = [joints[i] + part * (joints[i + 1] - joints[i]) for i in range(len(joints) - 1)]
    body = camera.to_camera(torch.cat([*chain, joints[-1:]]))  # (B, P, 3)
    length = (body[0, 1:] - body[0, :-1]).norm(dim=-1)
    share = torch.cat([length[:1], length[1:] + length[:-1], length[-1:]])[:, None]  # (P, 1) of the body
    weight = share * _inside(camera, body)
    return (weight * body).sum(1) / weight.sum(1) - (share * body).sum(1) / share.sum(0)


def _inside(camera: Camera, places: Tensor) -> Tensor:
    """1 for each of ``places`` (B, P, 3), in camera axes, in the frame; less the farther it is outside, (B, P, 1)."""
    pixels = (places / places[..., 2:].clamp_min(1e-6)) @ camera.K.transpose(1, 2)
    size = places.new_tensor(camera.size)
    beyond = torch.maximum(-pixels[..., :2], pixels[..., :2] - size).clamp_min(0).amax(-1, keepdim=True)
    beyond = torch.where(places[..., 2:] > 0, beyond / size[1], torch.inf)
    return 1 / (1 + (beyond / EDGE) ** 4).clamp_max(1e12)
