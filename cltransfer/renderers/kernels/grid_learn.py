"""Colours of single rays through a voxel grid, and how they change with the grid: what a fit needs.

The small helpers are those of ``grid_march``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ...computer.compiled import kernel
from . import CACHED, INLINE, Array, f32
from .grid_march import (
    LOOSE,
    MIN_TRANSMITTANCE,
    MOST_TERMS,
    Span,
    Triple,
    cross,
    interpolate,
    leave,
    set_basis,
    shade,
    slope_along,
)
from .grid_pack import BRICK

_ZERO, _HALF, _ONE = f32(0), f32(0.5), f32(1)
_MIN_TRANSMITTANCE = f32(MIN_TRANSMITTANCE)


class Field(NamedTuple):
    """A grid that is being learnt, and where it may hold matter."""

    density: Array  # (Z, Y, X) float32, per scene unit
    sh: Array  # (Z, Y, X, 3 K) float32
    cells: Array  # (Z - 1, Y - 1, X - 1) bool, others count as empty
    bricks: Array  # (z, y, x) uint8, as in Packed, of ``cells``
    per_unit: Triple  # voxels per scene unit along x, y, z
    near: f32  # scene units
    delta: f32  # longest step, scene units


@njit(**INLINE, **LOOSE)
def _walk(field: Field, eye: Triple, slope: Triple, span: Span, basis: Array, log: tuple[Array, Array]) -> int:
    """March one ray and log what it meets: cells z, y, x, and optical thickness, light before, colour, part.

    It ends where the log does: from very far the rounded span of a ray is longer than the box.
    """
    cells, values = log
    last_z, last_y, last_x = field.cells.shape[0] - 1, field.cells.shape[1] - 1, field.cells.shape[2] - 1
    left, met, sample = _ONE, 0, 0
    while sample < span.steps and left >= _MIN_TRANSMITTANCE and met < len(cells):
        t = span.start + (f32(sample) + _HALF) * span.step
        u, v, w = eye[0] + t * slope[0], eye[1] + t * slope[1], eye[2] + t * slope[2]
        i, j, k = min(max(int(u), 0), last_x), min(max(int(v), 0), last_y), min(max(int(w), 0), last_z)
        brick = (i // BRICK, j // BRICK, k // BRICK)
        away = np.int64(field.bricks[brick[2], brick[1], brick[0]])
        if away > 0:
            behind = (leave(eye, slope, brick, away) - span.start) / span.step
            sample = max(sample + 1, int(np.ceil(behind - _HALF)))
            continue
        sample += 1
        if not field.cells[k, j, i]:
            continue
        cell, part = (k, j, i), (u - f32(i), v - f32(j), w - f32(k))
        optical = interpolate(field.density, cell, part) * span.length
        color = shade(field.sh, basis, cell, part)
        cells[met, 0], cells[met, 1], cells[met, 2] = k, j, i
        values[met, 0], values[met, 1] = optical, left
        for channel in range(3):
            values[met, 2 + channel], values[met, 5 + channel] = color[channel], part[channel]
        met += 1
        left *= np.exp(-optical)
    return met


@njit(**INLINE, **LOOSE)
def _cast(field: Field, ray: Array, basis: Array) -> tuple[Triple, Triple, Span]:
    """Eye in voxels, slope in voxels per depth and span of a ray (6,): eye in voxels, then world direction."""
    speed = np.sqrt(ray[3] * ray[3] + ray[4] * ray[4] + ray[5] * ray[5])
    direction, eye = (ray[3], ray[4], ray[5]), (ray[0], ray[1], ray[2])
    slope = (
        slope_along(ray[3], field.per_unit[0]),
        slope_along(ray[4], field.per_unit[1]),
        slope_along(ray[5], field.per_unit[2]),
    )
    set_basis(basis, direction, speed)
    return eye, slope, cross(eye, slope, speed, (field.near, field.delta), field.density)


@njit(**INLINE, **LOOSE)
def _scratch(field: Field) -> tuple[Array, Array]:
    """Log for the longest ray: but for rounding no span exceeds the box's diagonal."""
    diagonal = f32(2)
    for axis in range(3):
        diagonal += (f32(field.density.shape[2 - axis]) / field.per_unit[axis]) ** 2 / field.delta**2
    most = int(np.ceil(np.sqrt(diagonal))) + 2
    return np.empty((most, 3), np.int32), np.empty((most, 8), np.float32)


@kernel(**CACHED, **LOOSE)
def look(field: Field, rays: Array, colors: Array) -> None:
    """Colours over black, not limited to 1.

    Args:
        field: the grid.
        rays: (R, 6) float32: eye in voxels from vertex 0, and direction of unit depth in the world.
        colors: out, (R, 3) float32.
    """
    basis, log = np.empty(MOST_TERMS, np.float32), _scratch(field)
    for r in range(len(rays)):
        eye, slope, span = _cast(field, rays[r], basis)
        met = _walk(field, eye, slope, span, basis, log)
        colors[r] = _ZERO
        for s in range(met):
            weight = log[1][s, 1] * (_ONE - np.exp(-log[1][s, 0]))
            for channel in range(3):
                colors[r, channel] += weight * log[1][s, 2 + channel]


@kernel(**CACHED, **LOOSE)
def trace_back(field: Field, rays: Array, wanted: Array, density: Array, sh: Array) -> None:
    """Add to ``density`` and ``sh`` the slopes of sum(wanted * colors) of :func:`look`.

    Args:
        field: the grid.
        rays: (R, 6), as there.
        wanted: slope with regard to each colour, (R, 3) float32.
        density: out, shape of the grid's.
        sh: out, shape of the grid's.
    """
    basis, log = np.empty(MOST_TERMS, np.float32), _scratch(field)
    cells, values = log
    for r in range(len(rays)):
        eye, slope, span = _cast(field, rays[r], basis)
        met = _walk(field, eye, slope, span, basis, log)
        behind = _ZERO  # what all samples behind this one add to the sum
        for s in range(met - 1, -1, -1):
            before, after = values[s, 1], values[s, 1] * np.exp(-values[s, 0])
            gain = _ZERO
            for channel in range(3):
                gain += wanted[r, channel] * values[s, 2 + channel]
            thicker = (after * gain - behind) * span.length
            behind += (before - after) * gain
            k, j, i = cells[s, 0], cells[s, 1], cells[s, 2]
            for corner in range(8):
                dx, dy, dz = corner & 1, (corner >> 1) & 1, corner >> 2
                share = values[s, 5] if dx else _ONE - values[s, 5]
                share *= values[s, 6] if dy else _ONE - values[s, 6]
                share *= values[s, 7] if dz else _ONE - values[s, 7]
                density[k + dz, j + dy, i + dx] += share * thicker
                for channel in range(3):
                    if values[s, 2 + channel] > _ZERO:
                        change = share * (before - after) * wanted[r, channel]
                        for term in range(sh.shape[3] // 3):
                            sh[k + dz, j + dy, i + dx, 3 * term + channel] += change * basis[term]
