"""Which Gaussians a camera can see, nearest first."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from ...computer.compiled import kernel
from . import CACHED, INLINE, Array, f32
from .splat_pack import CHUNK

LOW_PASS = 0.3  # [px^2], added to the diagonal of every projected covariance (Kerbl et al. 2023)
LOW_PASS_REACH = f32(2.0)  # [px], 3.33 sigma of the low-pass alone, rounded up
TANGENT_MARGIN = 0.15  # of the frame, how far outside it the projection's tangents are clamped
DIGIT = 11  # bits a pass; three passes cover a positive float32
DIGIT_MASK = np.uint64(2**DIGIT - 1)


Pair = tuple[f32, f32]


class View(NamedTuple):
    """One camera as the kernels take it; axes right, down, forward. Scalars only: arrays would be counted in loops."""

    w2c: tuple[tuple[f32, ...], ...]  # 3 rows of 4
    eye: tuple[f32, ...]  # x, y, z in the world
    focal: Pair  # x, y [px]
    center: Pair  # x, y [px]
    tangent_low: Pair  # least x/z and y/z the Jacobian is taken at
    tangent_high: Pair
    width: int  # [px]
    height: int  # [px]
    near: f32  # scene units
    fade_rate: f32  # 1 / scene units; opacity grows by it behind the near plane
    antialiased: bool


class Settings(NamedTuple):
    """What all cameras of a call share: :class:`~cltransfer.renderers.gaussian_splats.GaussianSplats`."""

    near: float
    near_fade: float
    antialiased: bool


def make_view(w2c: Array, K: Array, size: tuple[int, int], settings: Settings) -> View:
    """View of w2c (4, 4) and K (3, 3) [px] at ``size`` (W, H)."""
    focal, center, extent = np.diag(K)[:2], K[:2, 2], np.array(size, np.float64)
    margin = TANGENT_MARGIN * extent / focal
    eye = -w2c[:3, :3].T @ w2c[:3, 3]
    return View(
        w2c=tuple(_scalars(row) for row in w2c[:3]),
        eye=_scalars(eye),
        focal=_scalars(focal),
        center=_scalars(center),
        tangent_low=_scalars(-center / focal - margin),
        tangent_high=_scalars((extent - center) / focal + margin),
        width=size[0],
        height=size[1],
        near=f32(settings.near),
        fade_rate=f32(1 / max(settings.near_fade, 1e-6)),
        antialiased=settings.antialiased,
    )


def _scalars(vector: Array) -> tuple[Any, ...]:
    return tuple(f32(value) for value in vector)


@njit(**INLINE)
def _side_planes(view: View, across: tuple[int, int]) -> tuple[Array, Array, Array]:
    """Tangents of the low and high sides of a part of the frame, (2,), and how much a radius of 1 widens each, (2, 2).

    A splat's projected extent grows with the tangent its Jacobian is taken at, which is clamped outside the frame.
    """
    low, high, widen = np.empty(2, np.float32), np.empty(2, np.float32), np.empty((2, 2), np.float32)
    for axis, (first, end) in enumerate((across, (0, view.height))):
        low[axis] = (f32(first) - view.center[axis] - LOW_PASS_REACH) / view.focal[axis]
        high[axis] = (f32(end) - view.center[axis] + LOW_PASS_REACH) / view.focal[axis]
        widen[axis, 0] = np.sqrt(1 + max(view.tangent_low[axis] ** 2, low[axis] ** 2))
        widen[axis, 1] = np.sqrt(1 + max(view.tangent_high[axis] ** 2, high[axis] ** 2))
    return low, high, widen


@njit(**INLINE)
def _inside(x: f32, y: f32, z: f32, radius: f32, planes: tuple[Array, Array, Array]) -> bool:
    """Whether a sphere at camera coordinates can touch the frame, near plane aside."""
    low, high, widen = planes
    return (
        (x <= z * high[0] + radius * widen[0, 1])
        & (x >= z * low[0] - radius * widen[0, 0])
        & (y <= z * high[1] + radius * widen[1, 1])
        & (y >= z * low[1] - radius * widen[1, 0])
    )


@kernel(**CACHED)
def cull(bounds: Array, chunks: Array, view: View, across: tuple[int, int], ids: Array, depths: Array) -> int:
    """Write rows and depths of Gaussians that can touch the frame's columns; return their number.

    Args:
        bounds: (V, 4) mean and radius.
        chunks: (C, 4) the same of each 128.
        view: the camera.
        across: first column [px] and the one after the last.
        ids: out, (V + 1,) int32.
        depths: out, (V + 1,) float32, scene units.
    """
    planes = _side_planes(view, across)
    m = view.w2c
    count = 0
    for chunk in range(len(chunks)):
        px, py, pz, radius = chunks[chunk, 0], chunks[chunk, 1], chunks[chunk, 2], chunks[chunk, 3]
        z = m[2][0] * px + m[2][1] * py + m[2][2] * pz + m[2][3]
        x = m[0][0] * px + m[0][1] * py + m[0][2] * pz + m[0][3]
        y = m[1][0] * px + m[1][1] * py + m[1][2] * pz + m[1][3]
        if z + radius < view.near or not _inside(x, y, z, radius, planes):
            continue
        for i in range(chunk * CHUNK, min(len(bounds), (chunk + 1) * CHUNK)):
            px, py, pz, radius = bounds[i, 0], bounds[i, 1], bounds[i, 2], bounds[i, 3]
            z = m[2][0] * px + m[2][1] * py + m[2][2] * pz + m[2][3]
            x = m[0][0] * px + m[0][1] * py + m[0][2] * pz + m[0][3]
            y = m[1][0] * px + m[1][1] * py + m[1][2] * pz + m[1][3]
            ids[count], depths[count] = i, z  # written always, kept by the count: no branch
            count += int((z > view.near) & _inside(x, y, z, radius, planes))
    return count


@kernel(**CACHED)
def sort_by_depth(ids: Array, depths: Array, count: int, keys: Array, spare: Array) -> None:
    """Reorder ``ids[:count]`` by rising depth > 0: a stable radix sort of the float bits, which order as the floats.

    Unlike buckets of equal depth it does not slow down when one Gaussian lies far behind all others.

    Args:
        ids: (V + 1,) int32, changed.
        depths: (V + 1,) float32, > 0.
        count: how many are valid.
        keys: scratch, (V + 1,) uint64.
        spare: scratch, (V + 1,) uint64.
    """
    bits = depths.view(np.uint32)
    starts = np.zeros((3, 2**DIGIT + 1), np.int64)
    for k in range(count):
        keys[k] = np.uint64(bits[k]) << np.uint64(32) | np.uint64(ids[k])
        for digit in range(3):
            starts[digit, (keys[k] >> np.uint64(32 + DIGIT * digit) & DIGIT_MASK) + np.uint64(1)] += 1
    for digit in range(3):
        for bucket in range(2**DIGIT):
            starts[digit, bucket + 1] += starts[digit, bucket]
        for k in range(count):
            bucket = keys[k] >> np.uint64(32 + DIGIT * digit) & DIGIT_MASK
            spare[starts[digit, bucket]] = keys[k]
            starts[digit, bucket] += 1
        keys, spare = spare, keys
    for k in range(count):
        ids[k] = np.int32(keys[k] & np.uint64(0xFFFFFFFF))
