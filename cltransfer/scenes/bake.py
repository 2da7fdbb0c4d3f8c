"""One geometry in three representations: the surface of a mesh as flat Gaussians, or as a shell in a voxel grid.

With the geometry held fixed, the representation is the only thing that differs between two runs. Colour is what the
mesh is painted with; light that a renderer would add is not baked.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from kornia.geometry.conversions import rotation_matrix_to_quaternion
from torch import Tensor
from torch.nn.functional import normalize

from ..computer.memory import require_free
from ..errors import UsageError
from .columns import SH0
from .meshes.mesh import Mesh, folded
from .nerf_grid import MOST_VERTICES, NerfGrid
from .splats import Splats

SPREAD = 0.65  # standard deviation of a Gaussian, in distances between samples: less shows holes, more blurs edges
FLATNESS = 0.1  # thickness over width
OPACITY = 0.8
SHELL_DEPTH = 6.0  # optical depth of the shell, seen along its normal
INSET = 0.5  # voxels by which the shell lies inside the surface, so that its outline and its front do not grow
MARGIN = 2  # empty cells around the shell
PER_CELL = 3.0  # samples along a cell's edge
VERTEX_BYTES, SAMPLE_BYTES = 300, 420  # of a grid while it is baked, measured and rounded up
SPLAT_BYTES, FACE_BYTES = 480, 160  # of a Gaussian and of a face while they are baked, likewise
BLOCK = 2**18  # faces whose area is worked out at once: 40 MB
_PLASTIC = 1.32471795724474602596  # its powers give the most even sequence of points in a triangle


@dataclass(frozen=True)
class Samples:
    """N points spread evenly over a surface.

    Args:
        points: in the world, (N, 3) float64.
        normals: unit, to the side from which the corners of a face go counter-clockwise, (N, 3).
        colors: RGB in [0, 1], (N, 3).
        label: membership in the subject, (N,).
        area: of the surface that one point stands for, squared scene units.
    """

    points: Tensor  # (N, 3)
    normals: Tensor  # (N, 3)
    colors: Tensor  # (N, 3)
    label: Tensor  # (N,)
    area: float


def sample_surface(mesh: Mesh, count: int) -> Samples:
    """About ``count`` points of a mesh, as many in each face as its area is due; holes of a texture have none.

    Without random numbers: points are evenly spaced along the area of the faces, and by a low-discrepancy sequence
    inside them.

    Raises:
        ValueError: ``count`` is not positive, or the mesh has no area.
    """
    if count < 1:
        raise ValueError(f"expected a positive count, got {count}")
    across = _across(mesh, mesh.faces)
    areas = across.norm(dim=1) / 2
    total = _positive(float(areas.sum()), mesh)
    index = torch.arange(count, dtype=torch.float64)
    face = torch.searchsorted(areas.cumsum(0), (index + 0.5) / count * total).clamp(max=len(areas) - 1)
    weights = _barycentric(index)
    points = (mesh.vertices[mesh.faces[face].long()].double() * weights[..., None]).sum(1)
    colors, solid = _painted(mesh, face, weights)
    normals = normalize(across[face], dim=1, eps=torch.finfo(across.dtype).tiny)  # of small faces too
    return Samples(points[solid], normals[solid], colors[solid], mesh.label[face][solid], total / count)


def surface_area(mesh: Mesh) -> float:
    """Of all faces, squared scene units."""
    return sum(float(_across(mesh, faces).norm(dim=1).sum()) for faces in mesh.faces.split(BLOCK)) / 2


def _across(mesh: Mesh, faces: Tensor) -> Tensor:
    """Normals of ``faces`` of the mesh, (F, 3) float64, twice as long as each has area."""
    corners = mesh.vertices[faces.long()].double()  # (F, 3, 3)
    return torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def _positive(area: float, mesh: Mesh) -> float:
    """The area.

    Raises:
        ValueError: there is none.
    """
    if not area > 0:
        raise ValueError(f"expected a mesh with an area, got {len(mesh)} faces of an area of {area}")
    return area


def _barycentric(index: Tensor) -> Tensor:
    """Weights of three corners (N, 3) that fill a triangle evenly."""
    a, b = (index / _PLASTIC + 0.5).frac(), (index / _PLASTIC**2 + 0.5).frac()
    beyond = a + b > 1
    a, b = torch.where(beyond, 1 - a, a), torch.where(beyond, 1 - b, b)
    return torch.stack([1 - a - b, a, b], dim=1)


def _painted(mesh: Mesh, face: Tensor, weights: Tensor) -> tuple[Tensor, Tensor]:
    """Colour (N, 3) of points in faces, and whether there is anything, (N,) bool."""
    corner = mesh.faces.long()[face]
    colors = (mesh.colors[corner] * weights[..., None]).sum(1)
    solid = torch.ones(len(face), dtype=torch.bool)
    uv = (mesh.uv[corner] * weights[..., None]).sum(1)
    texture = mesh.texture[face]
    for number, (image, wraps) in enumerate(mesh.wrapped):
        of_it = texture == number
        height, width = image.shape[:2]
        u, v = folded(uv[of_it], wraps).unbind(-1)
        column = (u * width).long().clamp(max=width - 1)
        row = (v * height).long().clamp(max=height - 1)
        texel = image[row, column].double() / 255
        colors[of_it] *= texel[:, :3]
        solid[of_it] = texel[:, 3] >= 0.5
    return colors, solid


def bake_splats(mesh: Mesh, count: int = 100_000) -> Splats:
    """The surface of ``mesh`` as about ``count`` flat Gaussians of one size.

    Raises:
        ValueError: ``count`` is not positive, or the mesh has no area.
        ResourceError: they take more memory than is free.
    """
    require_free(SPLAT_BYTES * count + FACE_BYTES * len(mesh), "", f"{count} Gaussians", "take fewer")
    samples = sample_surface(mesh, count)
    width = SPREAD * samples.area**0.5
    n = len(samples.points)
    return Splats(
        samples.points.float(),
        torch.tensor([width, width, FLATNESS * width]).repeat(n, 1),
        rotation_matrix_to_quaternion(_frames(samples.normals)).float(),
        torch.full((n,), OPACITY),
        ((samples.colors - 0.5) / SH0).float()[:, None],
        samples.label.float(),
    )


def _frames(normals: Tensor) -> Tensor:
    """Rotations (N, 3, 3) whose third column is along ``normals``."""
    axes = torch.eye(3, dtype=normals.dtype)
    helper = torch.where((normals[:, 2:].abs() < 0.9), axes[2], axes[0])
    first = normalize(torch.linalg.cross(helper, normals), dim=1)
    return torch.stack([first, torch.linalg.cross(normals, first), normals], dim=2).contiguous()


def bake_grid(mesh: Mesh, cells: int = 224) -> NerfGrid:
    """The surface of ``mesh`` as a shell of density, one voxel thick, in a grid of ``cells`` along its longest side.

    Raises:
        ValueError: there are less than 2 cells, or the mesh has no area.
        UsageError: there are more vertices than a grid may have.
        ResourceError: it takes more memory than is free.
    """
    if cells < 2:
        raise ValueError(f"cells must be at least 2, got {cells}")
    require_free(FACE_BYTES * len(mesh), "", f"{len(mesh)} faces", "thin the mesh")
    area = _positive(surface_area(mesh), mesh)
    used = mesh.vertices[mesh.faces.long().unique()].double()
    low, high = used.amin(0), used.amax(0)
    voxel = float((high - low).max()) / cells
    origin = low - MARGIN * voxel
    shape = ((high - origin) / voxel).ceil().long() + MARGIN + 1  # vertices along x, y, z
    count = int(area * (PER_CELL / voxel) ** 2) + 1
    _check_need(cells, int(shape.prod()), count, len(mesh))
    samples = sample_surface(mesh, count)
    values = torch.cat([torch.ones(len(samples.points), 1), samples.colors, samples.label[:, None]], dim=1)
    inside = samples.points - INSET * voxel * samples.normals
    sums = _gathered((inside - origin) / voxel, values.double(), shape)
    mass, known = sums[..., :1], sums[..., :1] > 0
    paint = _spread_out(torch.where(known, sums[..., 1:] / mass.clamp_min(1e-12), 0.0), known)
    aabb = torch.stack([origin, origin + (shape - 1) * voxel])
    density = SHELL_DEPTH * samples.area / voxel**3 * mass[..., 0]
    sh = ((paint[..., :3] - 0.5) / SH0)[..., None, :]
    return NerfGrid(density.float(), sh.float(), paint[..., 3].clamp(0, 1).float(), aabb)


def _check_need(cells: int, vertices: int, samples: int, faces: int) -> None:
    """Hold a grid against the limit of its files and against the memory there is."""
    if vertices > MOST_VERTICES:
        reason = (
            f"expected a grid of at most {MOST_VERTICES} vertices, {cells} cells along its longest side are {vertices}"
        )
        raise UsageError("", "cells", reason, "take fewer")
    need = VERTEX_BYTES * vertices + SAMPLE_BYTES * samples + FACE_BYTES * faces
    require_free(need, "", f"a grid's {vertices} vertices and {samples} samples", "take fewer cells")


def _gathered(places: Tensor, values: Tensor, shape: Tensor) -> Tensor:
    """Values (N, C) shared out to the eight vertices around places (N, 3) [cells], summed up, (Z, Y, X, C)."""
    nx, ny, nz = shape.tolist()
    base = places.floor().long()
    inside = places - base
    out = np.zeros((nz * ny * nx, values.shape[1]))
    for corner in torch.cartesian_prod(*[torch.arange(2)] * 3):
        share = torch.where(corner.bool(), inside, 1 - inside).prod(1)
        x, y, z = (base + corner).unbind(1)
        row = ((z * ny + y) * nx + x).numpy()
        for channel in range(values.shape[1]):
            out[:, channel] += np.bincount(row, (share * values[:, channel]).numpy(), len(out))
    return torch.from_numpy(out).reshape(nz, ny, nx, -1)


def _spread_out(paint: Tensor, known: Tensor) -> Tensor:
    """Paint (Z, Y, X, C) carried on to unknown vertices beside known ones: colour is interpolated across a cell."""
    planes = torch.cat([paint * known, known.double()], dim=-1).permute(3, 0, 1, 2)[None]
    near = torch.nn.functional.avg_pool3d(planes, 3, stride=1, padding=1)[0].permute(1, 2, 3, 0)
    around = near[..., :-1] / near[..., -1:].clamp_min(1e-12)
    return torch.where(known, paint, around)
