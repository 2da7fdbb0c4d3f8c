"""Where a scene ends is told of frames that look down into nothing, and of no sky."""

from __future__ import annotations

import math

import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.driver.guard import SCENE_DEPTH
from cltransfer.features import Features
from cltransfer.run.scene_end import shows_end

UP = torch.tensor([0.0, 0.0, 2.0])


def seen(end: float, pitch: float = 0.0) -> Features:
    """A frame of 64x36 from 1.5 above a ground that ends ``end`` away, looking down by ``pitch`` degrees."""
    eye = torch.tensor([[0.0, 0.0, 1.5]])
    target = eye + torch.tensor([[0.0, math.cos(math.radians(pitch)), -math.sin(math.radians(pitch))]])
    camera = Camera.look_at(eye, target, UP, math.radians(40), (64, 36))
    y, x = torch.meshgrid(torch.arange(36) + 0.5, torch.arange(64) + 0.5, indexing="ij")
    pixels = torch.stack([x, y], -1).reshape(1, -1, 2)
    rays = camera.unproject(pixels, torch.ones(1, 64 * 36)) - camera.center[:, None]
    depth = torch.where(rays[..., 2] < 0, -1.5 / rays[..., 2], torch.inf)
    there = depth * rays[..., :2].norm(dim=-1) < end
    return Features((64, 36), camera=camera, depth=depth.where(there, torch.nan).reshape(1, 36, 64))


@pytest.mark.parametrize(
    ("end", "pitch", "told"),
    [(100.0, 0.0, False), (12.0, 0.0, False), (5.0, 0.0, True), (5.0, -30.0, False), (0.5, 80, True)],
)
def test_a_ground_that_ends_near_is_told_and_a_sky_is_not(end: float, pitch: float, told: bool) -> None:
    assert shows_end(seen(end, pitch), UP).tolist() == [told]


def test_the_depth_that_counts_is_that_of_the_scene() -> None:
    frame = seen(5.0)
    network = Features((64, 36), camera=frame.camera, depth=torch.ones(1, 36, 64), extras={SCENE_DEPTH: frame.depth})
    assert shows_end(network, UP).tolist() == [True]
