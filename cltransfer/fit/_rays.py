"""Colours of rays through a grid with their gradients, by the kernels; the torch oracle is what they are tested on."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..renderers._nerf_grid_torch import Rays
from ..renderers.kernels import f32
from ..renderers.kernels.grid_learn import Field, look, trace_back
from ..renderers.kernels.grid_march import Settings
from ..renderers.kernels.grid_pack import distance_to_matter
from ..scenes.nerf_grid import NerfGrid


class _Colors(torch.autograd.Function):
    """(R, 3) of density (Z, Y, X), sh (Z, Y, X, K, 3), rays (R, 6) and the rest of the field."""

    @staticmethod
    def forward(ctx: Any, density: Tensor, sh: Tensor, rays: Tensor, rest: tuple[Any, ...]) -> Tensor:
        ctx.save_for_backward(density, sh, rays)
        ctx.rest = rest
        colors = torch.empty(len(rays), 3)
        look(Field(density.numpy(), sh.flatten(3).numpy(), *rest), rays.numpy(), colors.numpy())
        return colors

    @staticmethod
    def backward(ctx: Any, *slopes: Tensor) -> Any:
        density, sh, rays = ctx.saved_tensors
        to_density, to_sh = torch.zeros_like(density), torch.zeros_like(sh)
        field = Field(density.numpy(), sh.flatten(3).numpy(), *ctx.rest)
        trace_back(field, rays.numpy(), slopes[0].contiguous().numpy(), to_density.numpy(), to_sh.flatten(3).numpy())
        return to_density, to_sh, None, None


def distance_to_cells(cells: Tensor) -> Tensor:
    """Per brick the distance to the nearest brick with a cell of ``cells`` (Z - 1, Y - 1, X - 1), uint8."""
    vertices = np.zeros([side + 1 for side in cells.shape], np.float32)
    vertices[:-1, :-1, :-1] = cells.numpy()  # a brick owns the lower corners of its cells
    return torch.from_numpy(distance_to_matter(vertices))


def colors(grid: NerfGrid, rays: Rays, settings: Settings, cells: Tensor, bricks: Tensor) -> Tensor:
    """Colours over black in [0, 1], (R, 3), differentiable in the grid.

    Args:
        grid: float32, on the CPU.
        rays: float32; a ray meets nothing before its near plane.
        settings: near plane and longest step.
        cells: (Z - 1, Y - 1, X - 1) bool; outside them density counts as 0.
        bricks: :func:`distance_to_cells` of them.
    """
    eye = (rays.origin.double() - grid.aabb[0]) / grid.voxel
    flat = torch.cat([eye.float(), rays.direction], dim=1).contiguous()
    per_unit = tuple(f32(1 / edge) for edge in grid.voxel.tolist())
    delta = f32(settings.step * float(grid.voxel.min()))
    rest = (cells.numpy(), bricks.numpy(), per_unit, f32(settings.near), delta)
    drawn: Tensor = _Colors.apply(grid.density.contiguous(), grid.sh.contiguous(), flat, rest)
    return drawn.clamp(max=1)
