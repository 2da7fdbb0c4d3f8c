"""Frames of a result that show where the scene ends: they look down into nothing, where there can be no sky."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..driver.guard import SCENE_DEPTH
from ..features import Features

DOWN = math.radians(10)  # below the horizon; up to there a ground that ends far away may leave nothing
BARE = 0.05  # of the frame
SCENE_ENDS = "the scene ends within the frame: part of it looks down into nothing"


def shows_end(seen: Features, up: Tensor) -> Tensor:
    """Whether each of N frames shows nothing in :data:`BARE` of it, or more, that looks down, (N,) bool.

    Args:
        seen: with ``camera`` and the scene's ``depth`` (N, H, W), NaN where there is nothing.
        up: of the scene, (3,).
    """
    depth = seen.require(SCENE_DEPTH if seen.has(SCENE_DEPTH) else "depth")
    rows, columns = depth.shape[1:]
    camera = seen.require("camera").at_size((columns, rows))
    y, x = torch.meshgrid(torch.arange(rows) + 0.5, torch.arange(columns) + 0.5, indexing="ij")
    pixels = torch.stack([x, y], dim=-1).reshape(1, -1, 2).expand(len(depth), -1, 2)
    rays = camera.unproject(pixels, torch.ones(pixels.shape[:2])) - camera.center[:, None]  # (N, H W, 3)
    rise = torch.nn.functional.normalize(rays, dim=-1) @ (up.double() / up.double().norm())
    return ((rise < -math.sin(DOWN)) & ~torch.isfinite(depth.flatten(1))).double().mean(1) >= BARE
