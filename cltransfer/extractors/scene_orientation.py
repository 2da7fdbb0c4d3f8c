"""From which side the camera sees the lifted person."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import torch

from ..features import Features
from ..orientation import orientation_from_axes
from ..registry import EXTRACTORS


@EXTRACTORS.register("scene_orientation")
@dataclass(frozen=True)
class SceneOrientation:
    """Yaw, pitch and roll of the camera about the person's anchor; NaN where that is behind the camera."""

    requires: ClassVar[tuple[str, ...]] = ("camera", "person")
    provides: ClassVar[tuple[str, ...]] = ("orientation",)
    family: ClassVar[Literal["image", "scene", "both"]] = "scene"

    def __call__(self, now: Features, before: Features | None) -> Features:
        """``now`` with ``orientation``."""
        camera, person = now.require("camera"), now.require("person")
        axes = torch.stack([person.left, person.up]).to(camera.w2c) @ camera.w2c[:, :3, :3].transpose(1, 2)
        anchor = camera.to_camera(person.anchor[None])[:, 0]  # (B, 3)
        orientation = orientation_from_axes(axes[:, 0], axes[:, 1], -anchor)
        return replace(now, orientation=orientation.masked_fill(anchor[:, 2:] <= 0, float("nan")))
