"""The five functions of gsplat 1.5 that we call, in plain torch, so that our side of them runs without a GPU.

Written after gsplat's documentation: shapes, order of lists, and rows of unseen Gaussians that mean nothing (NaN).
"""

from __future__ import annotations

from collections.abc import Iterator

import torch
from kornia.geometry.conversions import quaternion_to_rotation_matrix
from torch import Tensor

ALPHA_THRESHOLD, MAX_ALPHA, ENOUGH = 1 / 255, 0.999, 1e-4


def fully_fused_projection(
    means: Tensor, covars: None, quats: Tensor, scales: Tensor, viewmats: Tensor, Ks: Tensor, width: int, height: int,
    eps2d: float, near_plane: float, calc_compensations: bool, opacities: Tensor,
) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor | None]:  # fmt: skip
    half = quaternion_to_rotation_matrix(quats) * scales[:, None]
    turn = viewmats[:, None, :3, :3]
    inside = (turn @ means[None, :, :, None])[..., 0] + viewmats[:, None, :3, 3]
    covariance = turn @ (half @ half.mT) @ turn.mT
    x, y, z = inside.unbind(-1)
    fx, fy, cx, cy = (Ks[:, i, j, None] for i, j in ((0, 0), (1, 1), (0, 2), (1, 2)))
    slope_x = torch.clamp(x / z, -cx / fx - 0.15 * width / fx, (width - cx) / fx + 0.15 * width / fx)
    slope_y = torch.clamp(y / z, -cy / fy - 0.15 * height / fy, (height - cy) / fy + 0.15 * height / fy)
    nought = torch.zeros_like(z)
    rows = [fx / z, nought, -fx * slope_x / z, nought, fy / z, -fy * slope_y / z]
    jacobian = torch.stack(rows, -1).unflatten(-1, (2, 3))
    flat = jacobian @ covariance @ jacobian.mT
    wide = flat + eps2d * torch.eye(2)
    sharpness = (torch.linalg.det(flat) / torch.linalg.det(wide)).clamp(min=0).sqrt()
    conic = torch.linalg.inv(wide)[..., [0, 0, 1], [0, 1, 1]]
    center = torch.stack([fx * x / z + cx, fy * y / z + cy], -1)
    peak = opacities * (sharpness if calc_compensations else 1)
    extend = (2 * (peak / ALPHA_THRESHOLD).clamp(min=1).log()).sqrt().clamp(max=3.33)
    radius = (extend[..., None] * wide.diagonal(dim1=-2, dim2=-1).sqrt()).ceil()
    seen = (z >= near_plane) & (peak >= ALPHA_THRESHOLD)
    seen &= ((center + radius > 0) & (center - radius < torch.tensor([width, height]))).all(-1)
    blank = torch.where(seen, 0.0, torch.nan)
    radii = torch.where(seen[..., None], radius, 0).int()
    out = (center + blank[..., None], z + blank, conic + blank[..., None])
    return radii, *out, sharpness + blank if calc_compensations else None


def isect_tiles(means2d: Tensor, radii: Tensor, depths: Tensor, tile_size: int, tile_width: int, tile_height: int):
    image, gaussian = (radii > 0).all(-1).nonzero().unbind(1)
    center, reach = means2d[image, gaussian] / tile_size, radii[image, gaussian] / tile_size
    grid = torch.tensor([tile_width, tile_height])
    low = (center - reach).floor().clamp(min=torch.zeros(2), max=grid)
    high = (center + reach).ceil().clamp(min=torch.zeros(2), max=grid)
    y, x = torch.meshgrid(torch.arange(tile_height), torch.arange(tile_width), indexing="ij")
    tiles = torch.stack([x, y], -1).reshape(1, -1, 2)
    row, tile = ((tiles >= low[:, None]) & (tiles < high[:, None])).all(-1).nonzero().unbind(1)
    bits = (tile_width * tile_height).bit_length()
    depth = depths[image, gaussian][row].float().view(torch.int32).long()
    keys, order = ((image[row] << bits | tile) << 32 | depth).sort(stable=True)
    ids = (image * means2d.shape[1] + gaussian)[row][order].int()
    return torch.zeros(means2d.shape[:2], dtype=torch.int32), keys, ids


def isect_offset_encode(isect_ids: Tensor, n_images: int, tile_width: int, tile_height: int) -> Tensor:
    tiles = tile_width * tile_height
    image, tile = isect_ids >> 32 >> tiles.bit_length(), (isect_ids >> 32) & (2 ** tiles.bit_length() - 1)
    counts = torch.bincount(image * tiles + tile, minlength=n_images * tiles)
    return (counts.cumsum(0) - counts).int().reshape(n_images, tile_height, tile_width)


def _tiles(
    given: tuple[Tensor, Tensor, Tensor], size: tuple[int, int], tile: int, offsets: Tensor, ids: Tensor,
    left: Tensor,
) -> Iterator[tuple[int, Tensor, Tensor, Tensor, Tensor]]:  # fmt: skip
    """Image, pixels (P, 2), Gaussians (M,), alpha and transmittance before (P, M), tile by tile; unused alpha is 0."""
    center, conic, opacity = given
    ends = torch.cat([offsets.flatten()[1:], torch.tensor([len(ids)])])
    _, rows, columns = offsets.shape
    for place, (first, last) in enumerate(zip(offsets.flatten().tolist(), ends.tolist())):
        image, row, column = place // (rows * columns), place // columns % rows, place % columns
        y, x = torch.meshgrid(torch.arange(tile) + row * tile, torch.arange(tile) + column * tile, indexing="ij")
        pixels = torch.stack([x, y], -1).reshape(-1, 2)
        pixels = pixels[(pixels < torch.tensor(size)).all(1)]
        members = ids[first:last].long() % center.shape[1]
        dx, dy = (center[image, members] - (pixels[:, None] + 0.5)).unbind(-1)
        a, b, c = conic[image, members].unbind(-1)
        alpha = (opacity[image, members] * torch.exp(-0.5 * (a * dx**2 + c * dy**2) - b * dx * dy)).clamp(max=MAX_ALPHA)
        alpha = torch.where(alpha < ALPHA_THRESHOLD, 0, alpha)
        after = left[image, pixels[:, 1], pixels[:, 0], None] * torch.cumprod(1 - alpha, dim=1)
        alpha = torch.where(after <= ENOUGH, 0, alpha)
        before = torch.cumprod(torch.cat([torch.ones(len(pixels), 1), 1 - alpha], 1), dim=1)[:, :-1]
        yield image, pixels, members, alpha, before


def rasterize_to_pixels(
    means2d: Tensor, conics: Tensor, colors: Tensor, opacities: Tensor, image_width: int, image_height: int,
    tile_size: int, isect_offsets: Tensor, flatten_ids: Tensor,
) -> tuple[Tensor, Tensor]:  # fmt: skip
    images, size = len(means2d), (image_width, image_height)
    out = torch.zeros(images, image_height, image_width, colors.shape[-1] + 1)
    one = torch.ones(images, image_height, image_width)
    for image, pixels, members, alpha, before in _tiles(
        (means2d, conics, opacities), size, tile_size, isect_offsets, flatten_ids, one
    ):
        values = torch.cat([colors[image, members], torch.ones(len(members), 1)], 1)
        out[image, pixels[:, 1], pixels[:, 0]] = (alpha * before) @ values
    return out[..., :-1], out[..., -1:]


def rasterize_to_indices_in_range(
    range_start: int, range_end: int, transmittances: Tensor, means2d: Tensor, conics: Tensor, opacities: Tensor,
    image_width: int, image_height: int, tile_size: int, isect_offsets: Tensor, flatten_ids: Tensor,
) -> tuple[Tensor, Tensor, Tensor]:  # fmt: skip
    found = []
    for image, pixels, members, alpha, _ in _tiles(
        (means2d, conics, opacities), (image_width, image_height), tile_size, isect_offsets, flatten_ids, transmittances
    ):
        pixel, member = (alpha > 0).nonzero().unbind(1)
        place = pixels[pixel, 1] * image_width + pixels[pixel, 0]
        found.append(torch.stack([members[member], place, torch.full_like(place, image)]))
    gaussian, pixel, image = torch.cat(found, 1)
    order = (image * image_width * image_height + pixel).argsort(stable=True)
    return gaussian[order], pixel[order], image[order]
