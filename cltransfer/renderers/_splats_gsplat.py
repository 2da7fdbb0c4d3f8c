"""Gaussian splats by gsplat's CUDA kernels: all cameras of a call together, by the rule of the other backends.

gsplat projects, sorts and blends. Opacity behind the near plane, colour and the median are made here, because gsplat
knows no fade and no median. Two differences remain: gsplat cuts the opacity of a splat in a pixel at 0.999 instead of
0.99, so that up to 0.009 less is seen of what lies behind one, and the factor of antialiasing has no floor, which here
is 0.005 of an opacity.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..camera import Camera
from ..scenes.splats import Splats
from ._splats_torch import faded, seen_colors
from .kernels.splat_composite import MIN_COVER, MIN_TRANSMITTANCE
from .kernels.splat_cull import LOW_PASS, Settings
from .kernels.splat_pack import MIN_ALPHA
from .kernels.splat_project import TILE

MOST_PROJECTED = 2**25  # Gaussians times cameras at once, about 2 GB
MOST_PIXELS = 2**21  # at once, for the lists of who covers them
SHADED = 2**20  # colours made at once: 200 MB of harmonics
EVERY_BATCH = 2**31 - 1  # gsplat walks lists in batches; this is to the end


class Ellipses(NamedTuple):
    """N Gaussians on the images of B cameras, as gsplat takes them."""

    center: Tensor  # (B, N, 2) [px]
    conic: Tensor  # (B, N, 3), upper triangle of the inverse covariance [1 / px^2]
    depth: Tensor  # (B, N), scene units
    peak: Tensor  # (B, N), opacity at the centre
    radius: Tensor  # (B, N, 2) int32 [px]; 0 where it is not seen


class Lists(NamedTuple):
    """Which Gaussians touch which tile, nearest first."""

    offsets: Tensor  # (B, rows, columns) int32
    ids: Tensor  # (M,) int32, into B * N


@torch.no_grad()
def render(splats: Splats, camera: Camera, settings: Settings, buffers: frozenset[str]) -> dict[str, Tensor]:
    """``buffers`` of B cameras on the device of ``splats``: image (B, 3, H, W), the others (B, H, W).

    Raises:
        ValueError: the scene is empty.
    """
    if len(splats) == 0:
        raise ValueError("gsplat needs at least one Gaussian")
    parts = [_render_group(splats, camera[group], settings, buffers) for group in groups(len(splats), camera)]
    return {name: torch.cat([part[name] for part in parts]) for name in buffers}


def groups(count: int, camera: Camera) -> Iterator[slice]:
    """Cameras that are drawn together when ``count`` Gaussians are projected into each."""
    width, height = camera.size
    most = max(1, min(MOST_PROJECTED // count, MOST_PIXELS // (width * height)))
    return (slice(first, first + most) for first in range(0, len(camera), most))


def _render_group(splats: Splats, camera: Camera, settings: Settings, buffers: frozenset[str]) -> dict[str, Tensor]:
    import gsplat

    ellipses = project(splats, camera, settings)
    lists = _lists(ellipses, camera.size)
    seen = (ellipses.radius > 0).all(-1)
    colored = "image" in buffers
    features = ellipses.depth.new_zeros(*seen.shape, 5 if colored else 2)
    features[..., -2], features[..., -1] = splats.label.float(), torch.where(seen, ellipses.depth, 0)
    if colored:
        _paint(features, splats, camera, seen)
    shape = (ellipses.center, ellipses.conic, features, ellipses.peak, *camera.size, TILE, *lists)
    sums, alpha = gsplat.rasterize_to_pixels(*shape)
    alpha = alpha[..., 0]
    mean = torch.where(alpha >= MIN_COVER, sums[..., -1] / alpha.clamp(min=MIN_COVER), torch.nan)
    drawn = {"alpha": alpha, "label": sums[..., -2], "expected_depth": mean}
    if colored:
        drawn["image"] = sums[..., :3].permute(0, 3, 1, 2).clamp(max=1)
    if "depth" in buffers:
        drawn["depth"] = _median_depth(ellipses, lists, camera.size)
    return {name: drawn[name] for name in buffers}


def projection(splats: Splats, camera: Camera, settings: Settings) -> dict[str, Any]:
    """Arguments of ``gsplat.fully_fused_projection``; its cameras and ours have the same axes and pixel corners."""
    return {
        "means": splats.means.float(),
        "covars": None,
        "quats": splats.quats.float(),
        "scales": splats.scales.float(),
        "viewmats": camera.w2c.to(splats.means.device, torch.float32),
        "Ks": camera.K.to(splats.means.device, torch.float32),
        "width": camera.size[0],
        "height": camera.size[1],
        "eps2d": LOW_PASS,
        "near_plane": settings.near,
        "calc_compensations": settings.antialiased,
        "opacities": splats.opacity.float(),  # only to bound how far a splat reaches
    }


def project(splats: Splats, camera: Camera, settings: Settings) -> Ellipses:
    """Gaussians on the images; what the near plane fades out is not seen."""
    import gsplat

    radius, center, depth, conic, sharpness = gsplat.fully_fused_projection(**projection(splats, camera, settings))
    peak = splats.opacity.float() * faded(depth, settings)
    if settings.antialiased:
        peak = peak * sharpness
    seen = (radius > 0).all(-1) & (peak > MIN_ALPHA)  # gsplat leaves the rest of an unseen row unset
    return Ellipses(center, conic, depth, torch.where(seen, peak, 0), radius * seen[..., None])


def _lists(ellipses: Ellipses, size: tuple[int, int]) -> Lists:
    import gsplat

    columns, rows = -(-size[0] // TILE), -(-size[1] // TILE)
    _, keys, ids = gsplat.isect_tiles(ellipses.center, ellipses.radius, ellipses.depth, TILE, columns, rows)
    offsets = gsplat.isect_offset_encode(keys, len(ellipses.center), columns, rows)
    return Lists(offsets.reshape(-1, rows, columns), ids)


def _paint(features: Tensor, splats: Splats, camera: Camera, seen: Tensor) -> None:
    """Fill in the colours (B, N, 3) of what is seen."""
    eyes = camera.center.to(splats.means)
    for pairs in seen.nonzero().split(SHADED):
        view, index = pairs.unbind(1)
        features[view, index, :3] = seen_colors(splats, index, eyes[view])


def _median_depth(ellipses: Ellipses, lists: Lists, size: tuple[int, int]) -> Tensor:
    """Depth (B, H, W) of the Gaussian behind which less than half of a pixel's light is left; NaN where none is.

    gsplat lists who covers a pixel, nearest first, until too little transmittance is left. Told that little is left
    to begin with, it stops at the half: as many come before the median.
    """
    import gsplat

    images, height, width = len(ellipses.center), size[1], size[0]
    whole = torch.ones(images, height, width, device=ellipses.center.device)
    given = (ellipses.center, ellipses.conic, ellipses.peak, width, height, TILE, *lists)
    _, *before = gsplat.rasterize_to_indices_in_range(0, EVERY_BATCH, whole * 2 * MIN_TRANSMITTANCE, *given)
    gaussian, *covered = gsplat.rasterize_to_indices_in_range(0, EVERY_BATCH, whole, *given)
    counts = [torch.bincount(image * width * height + pixel, minlength=whole.numel())
              for pixel, image in (before, covered)]  # fmt: skip
    at, crossed = median_places(*counts)
    depth = torch.full_like(whole, torch.nan).flatten()
    image = crossed.nonzero()[:, 0] // (width * height)
    depth[crossed] = ellipses.depth[image, gaussian[at]]
    return depth.reshape(whole.shape)


def median_places(before: Tensor, covered: Tensor) -> tuple[Tensor, Tensor]:
    """Where the pixels' medians stand in the list of all that cover them.

    Args:
        before: how many cover each pixel before half of its light is gone, (P,).
        covered: how many cover it in all; the list holds them pixel by pixel.

    Returns:
        Places in the list of the M pixels that have a median, (M,), and which these are, (P,) bool.
    """
    crossed = before < covered
    return (covered.cumsum(0) - covered + before)[crossed], crossed
