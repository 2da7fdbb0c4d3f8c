"""Memory layout of Gaussians for the CPU kernels: neighbours in space are neighbours in memory."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from . import Array

CHUNK = 128  # Gaussians that are culled together
MIN_ALPHA = 1 / 255  # a fainter contribution is skipped, as in the CUDA rasterisers
BLOCK = 1024 * CHUNK  # Gaussians that are bounded at once
CACHE_LINE = 64  # bytes
# columns of a geometry row
MEAN, COVARIANCE, OPACITY, LABEL, RADIUS, ROW = 0, 3, 9, 10, 11, 16


class Packed(NamedTuple):
    """V visible-at-all Gaussians in Morton order.

    ``geometry`` (V, 16) float32, one cache line a row: mean 3, covariance xx xy xz yy yz zz, opacity, label, radius
    beyond which alpha < 1/255, padding. ``bounds`` (V, 4): mean and radius again, dense for culling. ``chunks``
    (C, 4): centre and radius around each 128 rows. ``sh`` (V, 3 (d + 1)^2): coefficient-major, RGB inside.
    """

    geometry: Array
    bounds: Array
    chunks: Array
    sh: Array


def pack(means: Array, covariances: Array, scales: Array, opacity: Array, label: Array, sh: Array) -> Packed:
    """Sort, align and bound N Gaussians.

    Args:
        means: (N, 3) float32, finite, scene units.
        covariances: (N, 3, 3) float32.
        scales: standard deviations, (N, 3) float32, > 0.
        opacity: (N,) float32 in [0, 1].
        label: (N,) float32 in [0, 1].
        sh: (N, (d + 1)^2, 3) float32.

    Returns:
        Those with opacity above 1/255.
    """
    keep = packing_order(means, opacity)
    radius = np.sqrt(2 * np.log(opacity[keep] / MIN_ALPHA)) * scales[keep].max(axis=1)
    geometry = aligned((len(keep), ROW))
    geometry[:, :COVARIANCE] = means[keep]
    for column, (i, j) in enumerate(((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))):
        geometry[:, COVARIANCE + column] = covariances[keep, i, j]
    geometry[:, OPACITY], geometry[:, LABEL], geometry[:, RADIUS] = opacity[keep], label[keep], radius
    geometry[:, RADIUS + 1 :] = 0
    rows = aligned((len(keep), sh.shape[1] * 3))
    np.take(sh.reshape(len(sh), rows.shape[1]), keep, axis=0, out=rows, mode="clip")  # the only mode that needs no copy
    bounds = np.ascontiguousarray(geometry[:, [0, 1, 2, RADIUS]])
    return Packed(geometry, bounds, _spheres(bounds), rows)


def packing_order(means: Array, opacity: Array) -> Array:
    """Which Gaussian each packed row is, (V,): those that can be seen, along a Morton curve."""
    keep = np.nonzero(opacity > MIN_ALPHA)[0]
    return keep[np.argsort(morton_codes(means[keep]), kind="stable")]


def morton_codes(points: Array) -> Array:
    """Z-order codes (N,) uint64 of points (N, 3), 21 bits an axis: few metres of scene among far outliers."""
    if len(points) == 0:
        return np.zeros(0, np.uint64)
    low = points.min(axis=0).astype(np.float64)
    extent = max(float((points.max(axis=0) - low).max()), np.finfo(np.float64).tiny)
    cells = ((points - low) / extent * (2**21 - 1)).astype(np.uint64)
    return _spread(cells[:, 0]) | _spread(cells[:, 1]) << np.uint64(1) | _spread(cells[:, 2]) << np.uint64(2)


def _spread(bits: Array) -> Array:
    """Two empty bits behind each of the 21 low bits."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        bits = (bits | bits << np.uint64(shift)) & np.uint64(mask)
    return bits


def _spheres(bounds: Array) -> Array:
    """Sphere (C, 4) around the spheres (V, 4) of each chunk."""
    if len(bounds) == 0:
        return np.zeros((0, 4), np.float32)
    blocks = (bounds[first : first + BLOCK] for first in range(0, len(bounds), BLOCK))
    return np.concatenate([_block_spheres(block) for block in blocks])


def _block_spheres(bounds: Array) -> Array:
    starts = np.arange(0, len(bounds), CHUNK)
    centers, radii = bounds[:, :3].astype(np.float64), bounds[:, 3:]
    low = np.minimum.reduceat(centers - radii, starts)
    high = np.maximum.reduceat(centers + radii, starts)
    middle = (low + high) / 2
    reach = np.linalg.norm(centers - np.repeat(middle, CHUNK, axis=0)[: len(bounds)], axis=1) + bounds[:, 3]
    return np.concatenate([middle, np.maximum.reduceat(reach, starts)[:, None]], axis=1).astype(np.float32)


def aligned(shape: tuple[int, int]) -> Array:
    """Uninitialised float32 array that starts on a cache line."""
    size = shape[0] * shape[1] * 4
    raw = np.empty(size + CACHE_LINE, np.uint8)
    start = -raw.ctypes.data % CACHE_LINE
    return raw[start : start + size].view(np.float32).reshape(shape)
