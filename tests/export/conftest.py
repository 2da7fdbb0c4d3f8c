"""A path that every format has to keep: turned, zoomed, rolled, at uneven times, with its lens off the middle."""

import math

import pytest
import torch

from cltransfer.camera import Camera, intrinsics
from cltransfer.trajectory import Trajectory


@pytest.fixture
def path() -> Trajectory:
    generator = torch.Generator().manual_seed(3)
    eye = 3 * torch.randn(5, 3, generator=generator, dtype=torch.float64) + torch.tensor([8.0, 0, 0]).double()
    target = torch.randn(5, 3, generator=generator, dtype=torch.float64)
    fov = torch.linspace(0.3, 1.2, 5, dtype=torch.float64)
    camera = Camera.look_at(eye, target, torch.tensor([0.0, -0.9, 0.3]), fov, (1280, 720))
    camera.K[:, 0, 2] += 40
    camera.K[:, 1, 2] -= 25
    return Trajectory(camera, torch.tensor([0.0, 0.04, 0.1, 0.13, 0.2], dtype=torch.float64))


@pytest.fixture
def still() -> Trajectory:
    """At (1, 2, 3) in a z-up world, looking along +y: 90 degrees high, 200 x 100 px."""
    w2c = torch.tensor([[1.0, 0, 0, -1], [0, 0, -1, 3], [0, 1, 0, -2], [0, 0, 0, 1]]).double()[None]
    K = intrinsics(torch.tensor([50.0], dtype=torch.float64), (200, 100))
    assert 2 * math.atan(100 / (2 * 50)) == pytest.approx(math.radians(90))
    return Trajectory(Camera(w2c, K, (200, 100)), torch.zeros(1, dtype=torch.float64))


POINTS = torch.randn(20, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)


@pytest.fixture
def seen(path: Trajectory) -> list[list[tuple[list[float], list[float]]]]:
    """For each camera world points before it and their pixels."""
    pixels, depths = path.camera.project(POINTS)
    return [
        [(point.tolist(), pixel.tolist()) for point, pixel, depth in zip(POINTS, row, far) if depth > 0.1]
        for row, far in zip(pixels, depths)
    ]
