"""A scene in closed form: a ball with a smooth pattern above a disc, before black, seen exactly."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from cltransfer.camera import Camera
from cltransfer.fit._views import Views
from cltransfer.renderers._nerf_grid_torch import camera_rays

BOX = torch.tensor([[-1.1, -1.1, -0.9], [1.1, 1.1, 0.8]], dtype=torch.float64)
RADIUS, DISC, HEIGHT = 0.6, 1.0, -0.7
OVERSAMPLE = 3


@pytest.fixture(scope="session")
def views() -> Views:
    """25 views of the scene."""
    return analytic_views(25, (48, 48))


def analytic_views(count: int, size: tuple[int, int], seed: int = 0) -> Views:
    """``count`` images from all around, each pixel the mean of nine rays."""
    random = torch.Generator().manual_seed(seed)
    turn = torch.arange(count) * math.pi * (3 - math.sqrt(5))
    rise = 0.1 + 0.7 * torch.rand(count, generator=random)
    eyes = 3.0 * torch.stack([turn.cos() * rise.cos(), turn.sin() * rise.cos(), rise.sin()], dim=1)
    camera = Camera.look_at(eyes, torch.zeros(1, 3), torch.tensor([0.0, 0, 1]), 0.8, size)
    fine = camera.at_size((size[0] * OVERSAMPLE, size[1] * OVERSAMPLE))
    rays = camera_rays(fine)
    colors = trace(rays.origin, torch.nn.functional.normalize(rays.direction, dim=1))
    image = colors.reshape(count, *fine.size[::-1], 3).permute(0, 3, 1, 2)
    image = torch.nn.functional.avg_pool2d(image, OVERSAMPLE)
    return Views(camera, (image * 255).round().to(torch.uint8), BOX)


def trace(origin: Tensor, direction: Tensor) -> Tensor:
    """Colours (R, 3) of rays with unit directions."""
    half = (origin * direction).sum(1)
    root = half**2 - (origin**2).sum(1) + RADIUS**2
    ball = torch.where(root > 0, -half - root.clamp(min=0).sqrt(), torch.inf)
    disc = (HEIGHT - origin[:, 2]) / direction[:, 2]
    landing = origin + disc[:, None] * direction
    disc = torch.where((disc > 0) & (landing[:, :2].norm(dim=1) < DISC), disc, torch.inf)
    normal = (origin + ball[:, None] * direction) / RADIUS
    ball_color = 0.5 + 0.4 * torch.stack([normal[:, 0], (3 * normal[:, 2]).sin(), (4 * normal[:, 1]).cos()], 1)
    disc_color = 0.5 + 0.3 * torch.stack([(4 * landing[:, 0]).sin(), (3 * landing[:, 1]).cos(), 0 * disc], 1)
    nearest = torch.where((ball < disc)[:, None], ball_color, disc_color)
    return torch.where((torch.minimum(ball, disc) < torch.inf)[:, None], nearest, 0)
