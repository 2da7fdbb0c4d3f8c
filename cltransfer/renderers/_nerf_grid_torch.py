"""Voxel grids in plain torch: the rule the kernels are tested against, and differentiable.

Readable first, and no brick is skipped unless a fit says which cells are empty.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import grid_sample, normalize

from ..camera import Camera
from ..scenes.nerf_grid import NerfGrid
from ._splats_torch import sh_basis
from .kernels.grid_march import MIN_COVER, MIN_SLOPE, MIN_TRANSMITTANCE, Settings

CHUNK = 4096  # rays that are marched at once


class Rays(NamedTuple):
    """R rays; a point is origin + t * direction with t the depth along the optical axis of the ray's camera."""

    origin: Tensor  # (R, 3), scene units
    direction: Tensor  # (R, 3), of unit depth and therefore longer than 1


class Samples(NamedTuple):
    """Midpoints of equal steps inside the box; a ray has fewer than S of them or none."""

    points: Tensor  # (R, S, 3), scene units
    depth: Tensor  # (R, S), scene units
    inside: Tensor  # (R, S) bool
    step: Tensor  # (R,), depth of a step, scene units
    length: Tensor  # (R,), of a step, scene units


def camera_rays(camera: Camera) -> Rays:
    """Rays through all pixel centres of B cameras, row by row, R = B * H * W."""
    width, height = camera.size
    rows, columns = (torch.arange(side, dtype=camera.K.dtype, device=camera.K.device) + 0.5 for side in (height, width))
    y, x = torch.meshgrid(rows, columns, indexing="ij")
    pixels = torch.stack([x, y], dim=-1).reshape(1, -1, 2)
    flat = (pixels - camera.K[:, None, :2, 2]) / camera.K.diagonal(dim1=1, dim2=2)[:, None, :2]
    inside = torch.cat([flat, torch.ones_like(flat[..., :1])], dim=-1)
    direction = inside @ camera.w2c[:, :3, :3]
    return Rays(camera.center[:, None].expand_as(direction).flatten(0, 1), direction.flatten(0, 1))


def render_one(grid: NerfGrid, camera: Camera, settings: Settings) -> dict[str, Tensor]:
    """All buffers of one camera: image (3, H, W), the others (H, W)."""
    rays = Rays(*(value.to(grid.density) for value in camera_rays(camera)))
    parts = [march(grid, Rays(*part), settings) for part in zip(*(value.split(CHUNK) for value in rays))]
    shape = (camera.size[1], camera.size[0])
    whole = {name: torch.cat([part[name] for part in parts]) for name in parts[0]}
    return {name: value.T.reshape(-1, *shape) if name == "image" else value.reshape(shape)
            for name, value in whole.items()}  # fmt: skip


def march(grid: NerfGrid, rays: Rays, settings: Settings, filled: Tensor | None = None) -> dict[str, Tensor]:
    """All buffers of R rays, differentiable in the grid and the rays.

    Args:
        grid: the field.
        rays: of the grid's type and device.
        settings: near plane and longest step.
        filled: cells (Z - 1, Y - 1, X - 1) outside which density counts as 0; None looks everywhere.

    Returns:
        image (R, 3) in [0, 1]; alpha, label (R,) in [0, 1]; depth (median) and expected_depth (R,), scene units, NaN
        where undefined.
    """
    samples = sample_rays(grid, rays, settings)
    keep = samples.inside if filled is None else samples.inside & _in_filled(grid, samples.points, filled)
    at = _to_unit_cube(grid, samples.points[keep])
    sigma = _at(grid.density[None], at)[0]
    optical = torch.zeros_like(samples.depth).masked_scatter(keep, sigma) * samples.length[:, None]
    passed = optical.cumsum(1)
    after, before = (-passed).exp(), (optical - passed).exp()
    before = torch.where(before >= MIN_TRANSMITTANCE, before, 0)  # a ray ends when less is left
    weight = before * -torch.expm1(-optical)
    alpha = weight.sum(1)
    color = _color(grid, rays, keep, at)
    spread = color.new_zeros(*keep.shape, 3).masked_scatter(keep[..., None], color)
    label = torch.zeros_like(weight).masked_scatter(keep, _at(grid.label[None], at)[0])
    crossing = (before > 0.5) & (after <= 0.5)
    behind = (2 * before).clamp(min=1).log() / optical.clamp(min=1e-12) - 0.5  # steps behind the midpoint
    median = torch.where(crossing, samples.depth + behind * samples.step[:, None], 0).sum(1)
    mean = (weight * samples.depth).sum(1) / alpha.clamp(min=MIN_COVER)
    return {
        "image": (weight[..., None] * spread).sum(1).clamp(max=1),
        "alpha": alpha,
        "label": (weight * label).sum(1),
        "depth": torch.where(median > 0, median, torch.nan),
        "expected_depth": torch.where(alpha >= MIN_COVER, mean, torch.nan),
    }


def sample_rays(grid: NerfGrid, rays: Rays, settings: Settings) -> Samples:
    """Samples of R rays from where each enters the box, or the near plane, to where it leaves."""
    aabb, voxel = grid.aabb.to(rays.origin), grid.voxel.to(rays.origin)
    slope = torch.where((rays.direction / voxel).abs() > MIN_SLOPE, rays.direction, MIN_SLOPE * voxel)
    sides = (aabb[:, None] - rays.origin) / slope  # (2, R, 3)
    start = sides.amin(0).amax(1).clamp(min=settings.near)
    span = (sides.amax(0).amin(1) - start).clamp(min=0)
    speed = rays.direction.norm(dim=1)
    count = torch.ceil(span * speed / (settings.step * voxel.min()))
    step = span / count.clamp(min=1)
    index = torch.arange(int(count.max()), device=span.device)
    depth = start[:, None] + (index + 0.5) * step[:, None]
    points = rays.origin[:, None] + depth[..., None] * rays.direction[:, None]
    return Samples(points, depth, index < count[:, None], step, step * speed)


def _to_unit_cube(grid: NerfGrid, points: Tensor) -> Tensor:
    aabb = grid.aabb.to(points)
    return (points - aabb[0]) / (aabb[1] - aabb[0]) * 2 - 1


def _at(values: Tensor, points: Tensor) -> Tensor:
    """Trilinear values (C, M) of a grid (C, Z, Y, X) at points (M, 3) of the cube [-1, 1]^3."""
    sampled = grid_sample(values[None], points[None, None, None], padding_mode="border", align_corners=True)
    return sampled[0, :, 0, 0]


def _color(grid: NerfGrid, rays: Rays, keep: Tensor, at: Tensor) -> Tensor:
    """Colour >= 0 of the kept samples, (M, 3), each seen along its ray."""
    coefficients = _at(grid.sh.flatten(3).permute(3, 0, 1, 2), at).T.unflatten(1, (-1, 3))  # (M, K, 3)
    basis = sh_basis(normalize(rays.direction, dim=1), grid.degree)[torch.nonzero(keep)[:, 0]]
    return (torch.einsum("mk,mkc->mc", basis, coefficients) + 0.5).clamp(min=0)


def _in_filled(grid: NerfGrid, points: Tensor, filled: Tensor) -> Tensor:
    """Whether points (R, S, 3) lie in filled cells, (R, S)."""
    most = torch.tensor(filled.shape[::-1], device=points.device) - 1
    cell = ((points - grid.aabb[0].to(points)) / grid.voxel.to(points)).long().clamp(min=0).minimum(most)
    return filled[cell[..., 2], cell[..., 1], cell[..., 0]]
