"""Joints of the lifted person, projected into the frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import torch
from kornia.geometry.camera import project_points
from torch import Tensor

from ..camera import Camera
from ..features import Features
from ..registry import EXTRACTORS

NEAR = 0.05  # of the subject's height: a joint nearer than this is projected from here, far out of the frame


def project_joints(camera: Camera, joints: Tensor, near: float) -> tuple[Tensor, Tensor]:
    """Pixels (B, J, 2) and depths (B, J) of world points (J, 3), continued behind the camera.

    A point nearer than ``near`` keeps its offset from the optical axis and is seen at depth ``near``. So
    pixels change steadily while a joint passes the camera, instead of jumping to the mirrored side. Where no
    point lies before the camera there is nobody to see: NaN.
    """
    inside = camera.to_camera(joints)
    depth = inside[..., 2]
    clamped = torch.cat([inside[..., :2], depth.clamp_min(near)[..., None]], dim=-1)
    pixels = project_points(clamped, camera.K[:, None].expand(*inside.shape[:2], 3, 3))
    nobody = ~(depth > near).any(1)
    return pixels.masked_fill(nobody[:, None, None], float("nan")), depth


def sample_map(values: Tensor, pixels: Tensor, size: tuple[int, int]) -> Tensor:
    """Values (B, J) of a map (B, H, W) at pixels (B, J, 2) of a frame of ``size``; the edge's outside."""
    height, width = values.shape[-2:]
    column = (pixels[..., 0] * width / size[0]).nan_to_num(0).clamp(0, width - 1).long()
    row = (pixels[..., 1] * height / size[1]).nan_to_num(0).clamp(0, height - 1).long()
    return values.flatten(1).gather(1, row * width + column)


@EXTRACTORS.register("scene_joints")
@dataclass(frozen=True)
class SceneJoints:
    """The 14 joints where the camera sees them.

    A joint's confidence is that of the lifted person, and 0 where it is out of the frame, behind the camera,
    unknown, or hidden: what is seen at its pixel is not the person and lies nearer than the joint. The body
    itself hides nothing, as pose networks also answer for the far shoulder.

    Args:
        tolerance: how much nearer a surface must be to hide a joint, >= 0, in heights of the person.
    """

    tolerance: float = 0.1

    requires: ClassVar[tuple[str, ...]] = ("camera", "person", "depth", "label")
    provides: ClassVar[tuple[str, ...]] = ("keypoints",)
    family: ClassVar[Literal["image", "scene", "both"]] = "scene"

    def __post_init__(self) -> None:
        if self.tolerance < 0:
            raise ValueError(f"tolerance must be >= 0, got {self.tolerance}")

    def __call__(self, now: Features, before: Features | None) -> Features:
        """``now`` with ``keypoints``."""
        person, size = now.require("person"), now.size
        near = NEAR * person.height
        pixels, depth = project_joints(now.require("camera").at_size(size), person.joints, near)
        in_frame = ((pixels >= 0) & (pixels < pixels.new_tensor(size))).all(-1) & (depth > near)
        seen_depth = sample_map(now.require("depth"), pixels, size)
        hidden = (sample_map(now.require("label"), pixels, size) < 0.5) & (
            seen_depth < depth - self.tolerance * person.height
        )
        confidence = person.confidence.expand_as(depth).masked_fill(~in_frame | hidden, 0)
        return replace(now, keypoints=torch.cat([pixels, confidence[..., None].to(pixels)], dim=-1))
