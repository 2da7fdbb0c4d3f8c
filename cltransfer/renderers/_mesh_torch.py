"""Triangle meshes in plain torch: the rule the kernels are tested against. Readable first."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import torch
from kornia.utils import create_meshgrid
from torch import Tensor
from torch.nn.functional import pixel_unshuffle

from ..camera import Camera
from ..scenes.meshes.mesh import Mesh, Wrap, folded
from .kernels.mesh import Settings
from .kernels.mesh_raster import FLAT, HOLE, INSIDE

CHUNK = 2_000_000  # pairs of a face and a pixel tested together


class Lens(NamedTuple):
    """Pinhole of a camera, on the device of the mesh."""

    focal: Tensor  # (2,) [px]
    middle: Tensor  # (2,) [px]
    size: tuple[int, int]  # (W, H) [px]


def render_one(mesh: Mesh, camera: Camera, settings: Settings) -> dict[str, Tensor]:
    """Buffers of one camera, float32: depth, expected_depth, alpha, label (H, W) and image (3, H, W)."""
    n = settings.samples
    device = mesh.vertices.device  # a camera lies on the CPU
    fine = camera.at_size((n * camera.size[0], n * camera.size[1]))
    K = fine.K[0].to(device)
    lens = Lens(K.diagonal()[:2], K[:2, 2], fine.size)
    corners = camera.to_camera(mesh.vertices)[0].to(device)[mesh.faces.long()]  # (F, 3, 3)
    face, depth = _nearest(mesh, corners, lens, settings.near)
    hit = face >= 0
    image = _image(mesh, corners, lens, face, settings.headlight)
    label = hit.float()
    label[hit] = mesh.label.float()[face[hit]]
    planes = {"alpha": hit.float(), "label": label, "depth": depth, "expected_depth": depth, "image": image}
    return {name: _pooled(name, plane, n) for name, plane in planes.items()}


def _pooled(name: str, plane: Tensor, n: int) -> Tensor:
    """One value a pixel, (..., H, W), of n x n rays: their mean, or their median of those that hit."""
    rays = pixel_unshuffle(plane.unsqueeze(-3), n)  # (..., n^2, H, W)
    if name == "depth":
        covered = rays.isfinite().float().mean(-3) >= 0.5
        return torch.where(covered, rays.nanmedian(-3).values, torch.nan)
    return rays.nanmean(-3)  # only a depth is ever NaN


def _nearest(mesh: Mesh, corners: Tensor, lens: Lens, near: float) -> tuple[Tensor, Tensor]:
    """Face (H, W) int64 (-1: none) and depth (H, W) float32 (NaN: none)."""
    width, height = lens.size
    parts = [_hits(mesh, corners, lens, near, chunk) for chunk in _chunks(corners, lens, near)]
    pixel, face, inverse = (torch.cat(column) for column in zip(*parts))
    inverse = inverse.float()  # of faces at one place the first is seen
    nearest = inverse.new_zeros(height * width).scatter_reduce(0, pixel, inverse, "amax")
    front = inverse == nearest[pixel]
    first = face.new_full((height * width,), len(mesh)).scatter_reduce(0, pixel[front], face[front], "amin")
    seen = torch.where(nearest > 0, first, -1).reshape(height, width)
    return seen, torch.where(nearest > 0, 1 / nearest, torch.nan).reshape(height, width)


def _chunks(corners: Tensor, lens: Lens, near: float) -> Iterator[tuple[Tensor, Tensor, int]]:
    """Faces (M,), the first pixel (M, 2) of the square each may cover, and the squares' common side."""
    low, high = _boxes(corners, lens, near)
    size = low.new_tensor(lens.size)
    low = (low - 0.5).ceil().clamp(min=torch.zeros_like(size), max=size).long()
    high = (high - 0.5).floor().clamp(min=-torch.ones_like(size), max=size - 1).long()
    side = (high - low + 1).amin(1).clamp(max=1) * (high - low + 1).amax(1)  # 0 where no pixel centre is in the box
    smaller = 0
    for most in [2**k for k in range(1, max(lens.size).bit_length() + 1)]:
        rows = ((side > smaller) & (side <= most)).nonzero()[:, 0]
        smaller = most
        for index in rows.split(max(1, CHUNK // most**2)):
            yield index, low[index], most


def _boxes(corners: Tensor, lens: Lens, near: float) -> tuple[Tensor, Tensor]:
    """Bounds (F, 2) [px] of each face's part beyond the near plane; empty where there is none."""
    after = corners.roll(-1, dims=1)
    share = ((near - corners[..., 2]) / (after[..., 2] - corners[..., 2]))[..., None]
    cut = corners + share * (after - corners)
    points = torch.cat([corners, cut], dim=1)
    kept = torch.cat([corners[..., 2] >= near, (corners[..., 2] >= near) != (after[..., 2] >= near)], dim=1)
    depth = torch.cat([corners[..., 2:], torch.full_like(cut[..., 2:], near)], dim=1)
    pixels = points[..., :2] / depth * lens.focal + lens.middle
    low = torch.where(kept[..., None], pixels, torch.inf).amin(1)
    high = torch.where(kept[..., None], pixels, -torch.inf).amax(1)
    return low, high


def _rays(pixels: Tensor, lens: Lens) -> Tensor:
    """Directions (..., 3) of depth 1 through the centres of integer pixels (..., 2)."""
    flat = (pixels + 0.5 - lens.middle) / lens.focal
    return torch.nn.functional.pad(flat, (0, 1), value=1.0)


def _weights(corners: Tensor, rays: Tensor) -> Tensor:
    """Each corner's weight over depth (..., 3) where rays (..., 3) meet the planes of ``corners`` (..., 3, 3)."""
    normals = torch.linalg.cross(corners.roll(-1, dims=-2), corners.roll(-2, dims=-2))
    determinant = (corners[..., 0, :] * normals[..., 0, :]).sum(-1)
    flat = determinant.abs() <= FLAT * corners.norm(dim=-1).prod(-1)
    over = (normals @ rays[..., None])[..., 0] / determinant[..., None]
    return torch.where(flat[..., None], torch.nan, over)


def _hits(
    mesh: Mesh, corners: Tensor, lens: Lens, near: float, chunk: tuple[Tensor, Tensor, int]
) -> tuple[Tensor, Tensor, Tensor]:
    """Pixel, face and 1 / depth (N,) wherever a face of the chunk covers a pixel of its square."""
    index, first, side = chunk
    width, height = lens.size
    grid = create_meshgrid(side, side, normalized_coordinates=False, device=first.device, dtype=torch.float64)
    pixels = first[:, None] + grid.reshape(1, -1, 2).long()  # (M, P, 2)
    over = _weights(corners[index, None], _rays(pixels, lens))
    inverse = over.sum(-1)
    inside = (inverse > 0) & (inverse <= 1 / near) & (over.amin(-1) >= INSIDE * inverse)
    inside &= (pixels[..., 0] < width) & (pixels[..., 1] < height)
    row, column = inside.nonzero(as_tuple=True)
    face, pixel = index[row], pixels[row, column]
    solid = ~_holes(mesh, face, over[row, column] / inverse[row, column, None])
    return (pixel[:, 1] * width + pixel[:, 0])[solid], face[solid], inverse[row, column][solid]


def _uv(mesh: Mesh, face: Tensor, weights: Tensor, wraps: tuple[Wrap, Wrap]) -> Tensor:
    """Place in the texture (N, 2), in [0, 1]; what is no number is at 0."""
    return folded((weights[..., None] * mesh.uv[mesh.faces[face].long()]).sum(1), wraps)


def _holes(mesh: Mesh, face: Tensor, weights: Tensor) -> Tensor:
    """Whether the texel there is transparent, (N,)."""
    hole = torch.zeros_like(face, dtype=torch.bool)
    for k, (image, wraps) in enumerate(mesh.wrapped):
        on = (mesh.texture[face] == k).nonzero()[:, 0]
        size = face.new_tensor([image.shape[1], image.shape[0]])
        x, y = (_uv(mesh, face[on], weights[on], wraps) * size).long().minimum(size - 1).unbind(-1)
        hole[on] = image[y, x, 3] < HOLE
    return hole


def _image(mesh: Mesh, corners: Tensor, lens: Lens, seen: Tensor, headlight: float) -> Tensor:
    """Colour (3, H, W) float32 of the faces seen."""
    row, column = (seen >= 0).nonzero(as_tuple=True)
    face = seen[row, column]
    rays = _rays(torch.stack([column, row], dim=1), lens)
    weights = _weights(corners[face], rays)
    weights = weights / weights.sum(-1, keepdim=True)
    edges = corners[face, 1:] - corners[face, :1]
    normal = torch.linalg.cross(edges[:, 0], edges[:, 1])
    facing = (normal * rays).sum(-1).abs() / (normal.norm(dim=-1) * rays.norm(dim=-1))  # of faces however small
    light = torch.where(mesh.shaded[face], 1 - headlight + headlight * facing, 1)
    color = light[:, None] * (weights[..., None] * mesh.colors[mesh.faces[face].long()]).sum(1)
    for k, (texture, wraps) in enumerate(mesh.wrapped):
        on = (mesh.texture[face] == k).nonzero()[:, 0]
        color[on] *= _bilinear(texture, _uv(mesh, face[on], weights[on], wraps), wraps)
    image = color.new_zeros(3, *seen.shape, dtype=torch.float32)
    image[:, row, column] = color.T.float().clamp(0, 1)
    return image


def _bilinear(texture: Tensor, uv: Tensor, wraps: tuple[Wrap, Wrap]) -> Tensor:
    """RGB (N, 3) in [0, 1] of a texture at places (N, 2) in [0, 1], between its four nearest texels."""
    height, width = texture.shape[:2]
    at = uv * uv.new_tensor([width, height]) - 0.5
    low = at.floor()
    share = at - low
    x0, y0 = low.long().unbind(-1)
    rgb = texture[..., :3].double() / 255
    x0, x1 = (_beside(x, width, wraps[0]) for x in (x0, x0 + 1))
    y0, y1 = (_beside(y, height, wraps[1]) for y in (y0, y0 + 1))
    above, below = (torch.lerp(rgb[y, x0], rgb[y, x1], share[:, :1]) for y in (y0, y1))
    return torch.lerp(above, below, share[:, 1:])


def _beside(index: Tensor, count: int, wrap: Wrap) -> Tensor:
    """Texels (N,) of which some are one beyond an edge; a mirror shows the one at the edge there, as a clamp does."""
    return index % count if wrap == "repeat" else index.clamp(0, count - 1)
