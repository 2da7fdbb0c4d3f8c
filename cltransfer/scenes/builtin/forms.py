"""One set of painted cells in three forms: a Gaussian for each cell, a quad for each cell, or the mark of a voxel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from kornia.geometry.conversions import rotation_matrix_to_quaternion
from torch import Tensor

from ..bake import bake_grid
from ..columns import SH0
from ..meshes.mesh import Mesh
from ..nerf_grid import NerfGrid
from ..splats import Splats
from .paint import Part, shade
from .surfaces import Array, Cells

_COVER = 1.32  # standard deviation of a Gaussian in half cells: neighbours overlap into a closed surface
_QUAD = 1.15  # a quad over its cell: round surfaces leave no slits between their rings
_THICK = 0.004  # [m]
GRID_REACH = 12.0  # [m] from the person along each axis: with the sky, a voxel would be as large as a head
GRID_CELLS = 256  # along the longest side


@dataclass(frozen=True)
class Painted:
    """N lit cells, in the set's axes.

    Args:
        cells: where they are.
        color: RGB, (N, 3).
        label: membership in the subject, (N,).
    """

    cells: Cells
    color: Array  # (N, 3)
    label: Array  # (N,)


def painted(parts: Sequence[Part], sun: Array, rng: np.random.Generator) -> Painted:
    """``parts`` cut into cells, painted and lit from ``sun`` (3,), any length."""
    cut = [part.surface.cells(part.spacing) for part in parts]
    color = np.concatenate([part.paint(cells.uv, rng) for part, cells in zip(parts, cut)])
    lit = np.concatenate([np.full(len(cells), part.lit) for part, cells in zip(parts, cut)])
    label = np.concatenate([np.full(len(cells), part.subject) for part, cells in zip(parts, cut)])
    rough = np.concatenate([np.full(len(cells), part.rough) for part, cells in zip(parts, cut)])
    cells = Cells.concatenate(cut)
    color[lit] *= shade(cells, cells.center[lit], sun / np.linalg.norm(sun))[lit]
    center = cells.center + rough[:, None] * rng.standard_normal((len(cells), 3))
    return Painted(replace(cells, center=center), np.clip(color, 0, 1), label.astype(float))


def as_splats(painted: Painted, world: Array) -> Splats:
    """One flat Gaussian for each cell; ``world`` (3, 3) has the scene's axes as rows."""
    scales, quats = _ellipsoids(painted.cells, world)
    return Splats(
        means=torch.from_numpy(painted.cells.center @ world).float(),
        scales=scales.float(),
        quats=quats.float(),
        opacity=torch.full((len(painted.cells),), 0.99),
        sh=torch.from_numpy((painted.color - 0.5) / SH0).float()[:, None],
        label=torch.from_numpy(painted.label).float(),
    )


def as_mesh(painted: Painted, world: Array) -> Mesh:
    """Two triangles for each cell, of one colour; the light is in the paint."""
    cells, n = painted.cells, len(painted.cells)
    corners = [
        cells.center + _QUAD * (u * cells.half_u + v * cells.half_v) for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    vertices = np.stack(corners, 1).reshape(-1, 3) @ world
    faces = (4 * np.arange(n)[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    colors = torch.from_numpy(painted.color.repeat(4, 0))
    mesh = Mesh.plain(torch.from_numpy(vertices), torch.from_numpy(faces), colors)
    return mesh.with_label(torch.from_numpy(painted.label.repeat(2)))


def as_grid(painted: Painted, world: Array, cells: int = GRID_CELLS) -> NerfGrid:
    """A voxel grid, ``cells`` along its longest side, of what lies in :data:`GRID_REACH`: outdoors it has no sky."""
    near = (np.abs(painted.cells.center) < GRID_REACH).all(1)
    inside = Cells(*(getattr(painted.cells, name)[near] for name in ("center", "half_u", "half_v", "uv")))
    return bake_grid(as_mesh(Painted(inside, painted.color[near], painted.label[near]), world), cells)


def _ellipsoids(cells: Cells, world: Array) -> tuple[Tensor, Tensor]:
    """Standard deviations (N, 3) [m] and rotations (N, 4) as w, x, y, z of Gaussians that fill cells."""
    wide, tall = (np.linalg.norm(half, axis=1) for half in (cells.half_u, cells.half_v))
    u, normal = cells.half_u / wide[:, None], cells.normal
    frame = np.stack([u, np.cross(normal, u), normal], 2)  # columns: the cell's axes
    scales = np.stack([wide * _COVER, tall * _COVER, np.full(len(cells), _THICK)], 1)
    return torch.from_numpy(scales), rotation_matrix_to_quaternion(torch.from_numpy(world.T @ frame))
