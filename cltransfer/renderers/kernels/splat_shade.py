"""View-dependent colour of projected Gaussians: real spherical harmonics up to degree 3."""

from __future__ import annotations

import numpy as np
from numba import njit

from ...computer.compiled import kernel
from . import FAST, FAST_INLINE, Array, f32
from .splat_cull import View
from .splat_project import BLUE, GREEN, RED, SOURCE, Slab, prefetch

AHEAD = 8  # Gaussians between prefetch and use
LINES = 3  # cache lines of a row of degree 3
_ZERO, _HALF, _ONE = f32(0), f32(0.5), f32(1)


@njit(**FAST_INLINE)
def _band1(x: f32, y: f32, z: f32) -> tuple[f32, ...]:
    c = f32(0.48860251)
    return -c * y, c * z, -c * x


@njit(**FAST_INLINE)
def _band2(x: f32, y: f32, z: f32) -> tuple[f32, ...]:
    c = f32(1.0925484)
    zonal = f32(0.94617470) * z * z - f32(0.31539157)
    return c * x * y, -c * y * z, zonal, -c * x * z, f32(0.54627422) * (x * x - y * y)


@njit(**FAST_INLINE)
def _band3(x: f32, y: f32, z: f32) -> tuple[f32, ...]:
    xx, yy, zz = x * x, y * y, z * z
    side = f32(-0.45704580) * (f32(5) * zz - _ONE)
    return (
        f32(-0.59004359) * y * (f32(3) * xx - yy),
        f32(2.8906114) * x * y * z,
        y * side,
        z * (f32(1.8658817) * zz - f32(1.1195290)),
        x * side,
        f32(1.4453057) * z * (xx - yy),
        f32(-0.59004359) * x * (xx - f32(3) * yy),
    )


@njit(**FAST_INLINE)
def _add_band(
    color: tuple[f32, f32, f32], sh: Array, row: int, column: int, basis: tuple[f32, ...]
) -> tuple[f32, f32, f32]:
    """Add the terms of one band, whose coefficients start at ``column``."""
    r, g, b = color
    for k in range(len(basis)):
        r += basis[k] * sh[row, column + 3 * k]
        g += basis[k] * sh[row, column + 3 * k + 1]
        b += basis[k] * sh[row, column + 3 * k + 2]
    return r, g, b


@kernel(**FAST)
def shade_slab(geometry: Array, sh: Array, view: View, slab: Slab, kept: int) -> None:
    """Write the colours of the slab's first ``kept`` Gaussians, >= 0, into their records.

    Args:
        geometry: (V, 16), see :class:`~cltransfer.renderers.kernels.splat_pack.Packed`.
        sh: (V, 3 (d + 1)^2).
        view: the camera.
        slab: in and out.
        kept: how many records are valid.
    """
    coefficients = sh.shape[1]
    for k in range(kept):
        row = slab.boxes[k, SOURCE]
        prefetch(sh, slab.boxes[min(k + AHEAD, kept - 1), SOURCE], LINES)  # type: ignore[call-arg]
        x, y, z = (
            geometry[row, 0] - view.eye[0],
            geometry[row, 1] - view.eye[1],
            geometry[row, 2] - view.eye[2],
        )
        scale = _ONE / np.sqrt(x * x + y * y + z * z)
        x, y, z = x * scale, y * scale, z * scale
        color = _add_band((_HALF, _HALF, _HALF), sh, row, 0, (f32(0.28209479),))
        if coefficients > 3:
            color = _add_band(color, sh, row, 3, _band1(x, y, z))
        if coefficients > 12:
            color = _add_band(color, sh, row, 12, _band2(x, y, z))
        if coefficients > 27:
            color = _add_band(color, sh, row, 27, _band3(x, y, z))
        slab.records[k, RED] = max(color[0], _ZERO)
        slab.records[k, GREEN] = max(color[1], _ZERO)
        slab.records[k, BLUE] = max(color[2], _ZERO)
