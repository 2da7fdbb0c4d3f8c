"""Gradients by the kernels against those of plain torch."""

from __future__ import annotations

import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.fit._rays import colors, distance_to_cells
from cltransfer.renderers._nerf_grid_torch import Rays, camera_rays, march
from cltransfer.renderers.kernels.grid_march import Settings
from cltransfer.scenes.nerf_grid import NerfGrid

SETTINGS = Settings(0.3, 0.5)


def field(degree: int, seed: int = 0) -> NerfGrid:
    random = torch.Generator().manual_seed(seed)
    shape = (17, 12, 21)
    lumps = torch.nn.functional.interpolate(
        torch.randn(1, 1, 4, 4, 4, generator=random), shape, mode="trilinear", align_corners=True
    )[0, 0]
    sh = torch.randn(*shape, (degree + 1) ** 2, 3, generator=random) * 0.5
    aabb = torch.tensor([[-1.0, -2, 0], [2, 2, 1.5]], dtype=torch.float64)
    return NerfGrid((lumps * 4).clamp(min=0).requires_grad_(), sh.requires_grad_(), torch.zeros(shape), aabb)


def rays() -> Rays:
    eyes = torch.tensor([[3.0, 1, 2], [-2, -2, 1], [0.4, 0.2, 0.7]])  # the last one is inside the box
    target = torch.tensor([[0.5, 0, 0.75], [0.5, 0, 0.75], [2, 0, 0]])
    camera = Camera.look_at(eyes, target, torch.tensor([0.0, 0, 1]), 0.9, (13, 9))
    return Rays(*(part.float() for part in camera_rays(camera)))


def slopes(grid: NerfGrid, drawn: torch.Tensor) -> tuple[torch.Tensor, ...]:
    """Of a random weighting of the colours, with regard to density and sh."""
    weight = torch.randn(drawn.shape, generator=torch.Generator().manual_seed(2))
    return torch.autograd.grad((drawn * weight).sum(), (grid.density, grid.sh))


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_colours_and_their_slopes_are_those_of_the_oracle(degree):
    grid = field(degree)
    cells = torch.ones(16, 11, 20, dtype=torch.bool)
    fast = colors(grid, rays(), SETTINGS, cells, distance_to_cells(cells))
    plain = march(grid, rays(), SETTINGS)["image"]
    assert plain.max() > 0.3
    torch.testing.assert_close(fast, plain, atol=1e-5, rtol=1e-4)
    for ours, theirs in zip(slopes(grid, fast), slopes(grid, plain)):
        assert theirs.abs().max() > 0.1
        # near the end of a ray, where 1e-4 of the light is left, rounding decides about one more sample
        torch.testing.assert_close(ours, theirs, atol=2e-3, rtol=1e-3)


def test_left_out_cells_count_as_empty_as_in_the_oracle():
    grid = field(1)
    cells = torch.rand(16, 11, 20, generator=torch.Generator().manual_seed(1)) < 0.4
    cells[:, :, 12:] = False  # whole bricks of nothing
    fast = colors(grid, rays(), SETTINGS, cells, distance_to_cells(cells))
    plain = march(grid, rays(), SETTINGS, cells)["image"]
    # a sample on the face between two cells may fall to either
    assert ((fast - plain).abs() > 1e-4).float().mean() < 0.05
    for ours, theirs in zip(slopes(grid, fast), slopes(grid, plain)):
        assert (ours - theirs).norm() < 0.1 * theirs.norm()


def test_density_of_zero_still_has_a_slope():
    grid = field(0)
    empty = NerfGrid(torch.zeros_like(grid.density).requires_grad_(), grid.sh, grid.label, grid.aabb)
    cells = torch.ones(16, 11, 20, dtype=torch.bool)
    drawn = colors(empty, rays(), SETTINGS, cells, distance_to_cells(cells))
    assert not drawn.any()
    (slope,) = torch.autograd.grad(drawn.sum(), empty.density)
    (theirs,) = torch.autograd.grad(march(empty, rays(), SETTINGS)["image"].sum(), empty.density)
    assert slope.abs().max() > 0
    torch.testing.assert_close(slope, theirs, atol=1e-5, rtol=1e-4)


def test_no_gradient_reaches_cells_that_are_left_out():
    grid = field(1)
    cells = torch.zeros(16, 11, 20, dtype=torch.bool)
    cells[:, :, :8] = True
    drawn = colors(grid, rays(), SETTINGS, cells, distance_to_cells(cells))
    slope, _ = torch.autograd.grad(drawn.sum(), (grid.density, grid.sh))
    assert slope[:, :, :9].abs().sum() > 0
    assert not slope[:, :, 9:].any()
