"""Optical flow of a static scene, computed from depth and the two cameras."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import torch
from torch import Tensor

from ..camera import Camera
from ..computer.arrays import plain
from ..features import Features
from ..registry import EXTRACTORS


def backward_flow(depth: Tensor, now: Camera, before: Camera) -> Tensor:
    """Where each pixel of a static scene was one frame before, relative to where it is.

    Args:
        depth: along the optical axis of ``now``, (B, H, W), scene units; it may have fewer pixels.
        now: B cameras.
        before: 1 or B cameras of the same size.

    Returns:
        (B, 2, H, W) float32 [px of the cameras' size]; NaN where depth is, and where the point lay behind the
        camera before. No gradient goes through it.

    Raises:
        ValueError: there is not one camera for each depth map.
    """
    from ._kernels import static_flow

    if len(depth) != len(now):
        raise ValueError(f"depth must have one map a camera, got {len(depth)} maps and {len(now)} cameras")
    back = now.K.inverse()
    motion = before.w2c @ now.c2w  # now's axes -> before's axes
    turn, shift = before.K @ motion[:, :3, :3] @ back, (before.K @ motion[:, :3, 3:])[..., 0]
    size = (float(now.size[0]), float(now.size[1]))
    flow = static_flow(plain(depth), turn.detach().cpu().numpy(), shift.detach().cpu().numpy(), size)
    return torch.from_numpy(flow).to(depth.device)


@EXTRACTORS.register("scene_flow")
@dataclass(frozen=True)
class SceneFlow:
    """Exact backward flow i -> i-1 from median depth; the mean depth would lie between two surfaces."""

    requires: ClassVar[tuple[str, ...]] = ("camera", "depth")
    provides: ClassVar[tuple[str, ...]] = ("flow",)
    family: ClassVar[Literal["image", "scene", "both"]] = "scene"
    needs_before: ClassVar[bool] = True

    def __call__(self, now: Features, before: Features | None) -> Features:
        """``now`` with ``flow``; NaN everywhere where there is no frame before."""
        depth, camera = now.require("depth"), now.require("camera").at_size(now.size)
        if before is None:
            return replace(now, flow=depth.new_full((len(depth), 2, *depth.shape[1:]), float("nan")))
        return replace(now, flow=backward_flow(depth, camera, before.require("camera").at_size(now.size)))
