"""Ray marching through a voxel grid: equal steps inside the box, empty bricks jumped over.

A ray is an eye and a direction of unit depth, so its parameter t is the depth along the optical axis.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from ...computer.compiled import kernel
from . import CACHED, INLINE, Array, Outputs, f32
from .grid_pack import BRICK, Packed

MIN_TRANSMITTANCE = 1e-4  # a ray ends when less is left
MIN_COVER = 1e-3  # alpha below which the mean depth means nothing
MIN_SLOPE = 1e-9  # of a ray along an axis [voxels per depth]; parallel rays are tilted by it
MOST_TERMS = 9  # spherical harmonics of degree 2

LOOSE: dict[str, Any] = {"fastmath": {"contract", "reassoc", "arcp", "nsz"}}  # NaN stays NaN
_ZERO, _HALF, _ONE, _UNDEFINED = f32(0), f32(0.5), f32(1), f32(np.nan)
_MIN_TRANSMITTANCE, _MIN_COVER, _MIN_SLOPE = f32(MIN_TRANSMITTANCE), f32(MIN_COVER), f32(MIN_SLOPE)
Triple = tuple[f32, f32, f32]


class View(NamedTuple):
    """One camera in the axes of the grid; scalars only."""

    eye: Triple  # x, y, z [voxels from vertex 0]
    c2w: tuple[Triple, ...]  # rows x, y, z
    per_unit: Triple  # voxels per scene unit along x, y, z
    focal: tuple[f32, f32]  # [px]
    center: tuple[f32, f32]  # [px]
    width: int  # [px]
    height: int  # [px]
    near: f32  # scene units
    delta: f32  # longest step, scene units


class Settings(NamedTuple):
    """What all cameras of a call share: :class:`~cltransfer.renderers.nerf_grid.NerfGridRenderer`."""

    near: float
    step: float


class Span(NamedTuple):
    """Where a ray crosses the box, and its steps there."""

    start: f32  # depth
    step: f32  # depth
    length: f32  # of a step, scene units
    steps: int


def make_view(packed: Packed, w2c: Array, K: Array, size: tuple[int, int], settings: Settings) -> View:
    """View of w2c (4, 4) and K (3, 3) [px] at ``size`` (W, H) in the axes of ``packed``."""
    eye = (-w2c[:3, :3].T @ w2c[:3, 3] - packed.low) / packed.voxel
    return View(
        eye=_scalars(eye),
        c2w=tuple(_scalars(row) for row in w2c[:3, :3].T),
        per_unit=_scalars(1 / packed.voxel),
        focal=_scalars(np.diag(K)[:2]),
        center=_scalars(K[:2, 2]),
        width=size[0],
        height=size[1],
        near=f32(settings.near),
        delta=f32(settings.step * packed.voxel.min()),
    )


def _scalars(vector: Array) -> tuple[Any, ...]:
    return tuple(f32(value) for value in vector)


@njit(**INLINE, **LOOSE)
def _rotate(c2w: tuple[Triple, ...], a: f32, b: f32) -> Triple:
    """World direction of the camera's (a, b, 1)."""
    return (
        c2w[0][0] * a + c2w[0][1] * b + c2w[0][2],
        c2w[1][0] * a + c2w[1][1] * b + c2w[1][2],
        c2w[2][0] * a + c2w[2][1] * b + c2w[2][2],
    )


@njit(**INLINE, **LOOSE)
def slope_along(component: f32, per_unit: f32) -> f32:
    """Cells per unit of depth along one axis, never 0."""
    slope = component * per_unit
    return slope if abs(slope) > _MIN_SLOPE else _MIN_SLOPE


@njit(**INLINE, **LOOSE)
def cross(eye: Triple, slope: Triple, speed: f32, reach: tuple[f32, f32], density: Array) -> Span:
    """Equal steps from where the ray enters the box or passes the near plane to where it leaves; reach: near, delta."""
    start, end = reach[0], f32(3e38)
    for axis in range(3):
        low = -eye[axis] / slope[axis]
        high = (f32(density.shape[2 - axis] - 1) - eye[axis]) / slope[axis]
        start, end = max(start, min(low, high)), min(end, max(low, high))
    if end <= start:
        return Span(start, _ONE, _ZERO, 0)
    count = max(1, int(np.ceil((end - start) * speed / reach[1])))
    step = (end - start) / f32(count)
    return Span(start, step, step * speed, count)


@njit(**INLINE, **LOOSE)
def leave(eye: Triple, slope: Triple, brick: tuple[int, int, int], away: int) -> f32:
    """Depth at which the ray leaves the cube of bricks that reaches ``away - 1`` bricks around ``brick`` (x, y, z)."""
    out = f32(3e38)
    for axis in range(3):
        side = brick[axis] + away if slope[axis] > 0 else brick[axis] - away + 1
        out = min(out, (f32(side * BRICK) - eye[axis]) / slope[axis])
    return out


@njit(**INLINE, **LOOSE)
def interpolate(values: Array, cell: tuple[int, int, int], part: Triple) -> f32:
    """Trilinear value in the cell at vertex (z, y, x), ``part`` of the way along x, y, z."""
    k, j, i = cell
    x, y, z = part
    near_low = values[k, j, i] + x * (values[k, j, i + 1] - values[k, j, i])
    near_high = values[k, j + 1, i] + x * (values[k, j + 1, i + 1] - values[k, j + 1, i])
    far_low = values[k + 1, j, i] + x * (values[k + 1, j, i + 1] - values[k + 1, j, i])
    far_high = values[k + 1, j + 1, i] + x * (values[k + 1, j + 1, i + 1] - values[k + 1, j + 1, i])
    near, far = near_low + y * (near_high - near_low), far_low + y * (far_high - far_low)
    return near + z * (far - near)


@njit(**INLINE, **LOOSE)
def shade(sh: Array, basis: Array, cell: tuple[int, int, int], part: Triple) -> Triple:
    """Colour >= 0 in the cell at vertex (z, y, x), seen along the direction of ``basis``."""
    k, j, i = cell
    x, y, z = part
    red, green, blue = _HALF, _HALF, _HALF
    for corner in range(8):
        dx, dy, dz = corner & 1, (corner >> 1) & 1, corner >> 2
        weight = (x if dx else _ONE - x) * (y if dy else _ONE - y) * (z if dz else _ONE - z)
        for term in range(sh.shape[3] // 3):
            factor = weight * basis[term]
            red += factor * sh[k + dz, j + dy, i + dx, 3 * term]
            green += factor * sh[k + dz, j + dy, i + dx, 3 * term + 1]
            blue += factor * sh[k + dz, j + dy, i + dx, 3 * term + 2]
    return max(red, _ZERO), max(green, _ZERO), max(blue, _ZERO)


@njit(**INLINE, **LOOSE)
def set_basis(basis: Array, direction: Triple, speed: f32) -> None:
    """Real spherical harmonics up to degree 2 of the direction, whose length is ``speed``."""
    x, y, z = direction[0] / speed, direction[1] / speed, direction[2] / speed
    first, second = f32(0.48860251), f32(1.0925484)
    basis[0] = f32(0.28209479)
    basis[1], basis[2], basis[3] = -first * y, first * z, -first * x
    basis[4], basis[5] = second * x * y, -second * y * z
    basis[6] = f32(0.94617470) * z * z - f32(0.31539157)
    basis[7], basis[8] = -second * x * z, f32(0.54627422) * (x * x - y * y)


@njit(**INLINE, **LOOSE)
def _write(out: Outputs, pixel: tuple[int, int], sums: tuple[f32, ...], median: f32) -> None:
    """Sums of red, green, blue, label, depth and what is left of the light, over black."""
    y, x = pixel
    red, green, blue, member, mean, left = sums
    alpha = _ONE - left
    if len(out.image):
        out.image[0, y, x], out.image[1, y, x], out.image[2, y, x] = min(red, _ONE), min(green, _ONE), min(blue, _ONE)
    if len(out.alpha):
        out.alpha[y, x] = alpha
    if len(out.label):
        out.label[y, x] = member
    if len(out.depth):
        out.depth[y, x] = median if median > _ZERO else _UNDEFINED
    if len(out.expected_depth):
        out.expected_depth[y, x] = mean / alpha if alpha >= _MIN_COVER else _UNDEFINED


@kernel(**CACHED, **LOOSE)
def march(packed: Packed, view: View, out: Outputs) -> int:
    """Render one view; return the number of samples that met matter.

    Args:
        packed: the grid; its box need not be in view.
        view: the camera.
        out: buffers to fill; those without rows are not computed.
    """
    density, bricks = packed.density, packed.bricks
    last_x, last_y, last_z = density.shape[2] - 2, density.shape[1] - 2, density.shape[0] - 2
    basis = np.empty(MOST_TERMS, np.float32)
    met = 0
    for y in range(view.height):
        for x in range(view.width):
            a, b = (f32(x) + _HALF - view.center[0]) / view.focal[0], (f32(y) + _HALF - view.center[1]) / view.focal[1]
            direction, speed = _rotate(view.c2w, a, b), np.sqrt(a * a + b * b + _ONE)
            slope = (
                slope_along(direction[0], view.per_unit[0]),
                slope_along(direction[1], view.per_unit[1]),
                slope_along(direction[2], view.per_unit[2]),
            )
            if len(out.image):
                set_basis(basis, direction, speed)
            span = cross(view.eye, slope, speed, (view.near, view.delta), density)
            red, green, blue, member, mean, median, left = _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ONE
            sample = 0
            while sample < span.steps and left >= _MIN_TRANSMITTANCE:
                t = span.start + (f32(sample) + _HALF) * span.step
                u, v, w = view.eye[0] + t * slope[0], view.eye[1] + t * slope[1], view.eye[2] + t * slope[2]
                i, j, k = min(max(int(u), 0), last_x), min(max(int(v), 0), last_y), min(max(int(w), 0), last_z)
                brick = (i // BRICK, j // BRICK, k // BRICK)
                away = np.int64(bricks[brick[2], brick[1], brick[0]])
                if away > 0:
                    behind = (leave(view.eye, slope, brick, away) - span.start) / span.step
                    sample = max(sample + 1, int(np.ceil(behind - _HALF)))
                    continue
                sample += 1
                cell, part = (k, j, i), (u - f32(i), v - f32(j), w - f32(k))
                sigma = interpolate(density, cell, part)
                if sigma <= _ZERO:
                    continue
                met += 1
                optical = sigma * span.length
                after = left * np.exp(-optical)
                weight = left - after
                mean += weight * t
                if left > _HALF and after <= _HALF:
                    median = t + (np.log(left + left) / optical - _HALF) * span.step
                if len(out.image):
                    color = shade(packed.sh, basis, cell, part)
                    red, green, blue = red + weight * color[0], green + weight * color[1], blue + weight * color[2]
                if len(out.label):
                    member += weight * interpolate(packed.label, cell, part)
                left = after
            _write(out, (y, x), (red, green, blue, member, mean, left), median)
    return met
