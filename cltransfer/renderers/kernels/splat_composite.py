"""Front-to-back compositing of a slab into tiles that stay in the L1 cache, eight pixels at a time."""

from __future__ import annotations

import numpy as np
from numba import njit

from ...computer.compiled import kernel
from . import CACHED, FAST, FAST_INLINE, Array, Outputs, f32
from .splat_cull import View
from .splat_pack import MIN_ALPHA
from .splat_project import (
    BLUE,
    DEPTH,
    GREEN,
    MEMBER,
    PEAK,
    QA,
    QB,
    QC,
    RED,
    TILE,
    X0,
    X1,
    Y0,
    Y1,
    Slab,
    Tiles,
    U,
    V,
)

LANES = 8  # pixels of a row that are blended together: one 256-bit register
STRIPS = TILE // LANES
AREA = np.uint64(TILE * TILE)  # pixels of one plane of a tile
STRIP_AREA = np.uint64(LANES * TILE)
MAX_ALPHA = 0.99  # Kerbl et al. 2023; gsplat has 0.999
MIN_TRANSMITTANCE = 1e-4  # the splat that would go below it is not added, and the pixel is finished
LOOK = 16  # splats of a tile between looks whether it is opaque
MIN_COVER = 1e-3  # alpha below which the mean depth means nothing
DEPTH_PLANES, ALL_PLANES = 4, 7  # transmittance, depth sum, label sum, median depth, then red, green, blue

_ZERO, _HALF, _ONE, _UNDEFINED = f32(0), f32(0.5), f32(1), f32(np.nan)
_MIN_ALPHA, _MAX_ALPHA = f32(MIN_ALPHA), f32(MAX_ALPHA)
_MIN_TRANSMITTANCE, _MIN_COVER = f32(MIN_TRANSMITTANCE), f32(MIN_COVER)
# exp(x) on [-6, 0] as p(x / 8)^8 with p the degree-5 interpolant at Chebyshev points, relative error < 4e-6
_E0, _E1, _E2, _E3, _E4, _E5 = (
    f32(c)
    for c in np.polynomial.Chebyshev.interpolate(np.exp, 5, domain=[-0.75, 0.0])
    .convert(kind=np.polynomial.Polynomial)
    .coef
)
_LOWEST_POWER = f32(-6)  # alpha is below 1/255 there


@njit(**FAST_INLINE)
def _blend(planes: Array, base: int, slab: Slab, k: int, corner: tuple[int, int], color: bool | None) -> None:
    """Blend record k into the tile at ``corner``; a finished pixel carries its transmittance negative."""
    record, box = slab.records, slab.boxes
    left, top = corner
    u, v, peak = record[k, U], record[k, V], record[k, PEAK]
    qa, qb, qc, depth, member = (
        record[k, QA],
        record[k, QB],
        record[k, QC],
        record[k, DEPTH],
        record[k, MEMBER],
    )
    red, green, blue = record[k, RED], record[k, GREEN], record[k, BLUE]
    first_row, last_row = max(box[k, Y0] - top, 0), min(box[k, Y1] - top, TILE - 1)
    first_strip = max(box[k, X0] - left, 0) // LANES
    last_strip = min(box[k, X1] - left, TILE - 1) // LANES
    for strip in range(first_strip, last_strip + 1):
        first_dx = f32(left + strip * LANES) + _HALF - u
        at = base + np.uint64(strip) * STRIP_AREA + np.uint64(first_row) * np.uint64(LANES)
        for row in range(first_row, last_row + 1):
            dy = f32(top + row) + _HALF - v
            across, along = qc * dy * dy, qb * dy
            for lane in range(np.uint64(LANES)):  # no branches, unit stride: becomes vector instructions
                dx = first_dx + f32(lane)
                e = max(across + dx * (along + qa * dx), _LOWEST_POWER) * f32(0.125)
                e = _E0 + e * (_E1 + e * (_E2 + e * (_E3 + e * (_E4 + e * _E5))))
                e = e * e
                e = e * e
                alpha = min(peak * e * e, _MAX_ALPHA)
                alpha = alpha if alpha >= _MIN_ALPHA else _ZERO
                before = planes[at + lane]
                weight = max(before, _ZERO) * alpha
                after = before - weight
                finished = after < _MIN_TRANSMITTANCE
                weight = _ZERO if finished else weight
                after = -abs(before) if finished else after
                planes[at + lane] = after
                planes[at + lane + AREA] += weight * depth
                planes[at + lane + np.uint64(2) * AREA] += weight * member
                median = planes[at + lane + np.uint64(3) * AREA]
                crossing = (before > _HALF) & (after <= _HALF)
                planes[at + lane + np.uint64(3) * AREA] = depth if crossing else median
                if color is not None:  # settled at compile time
                    planes[at + lane + np.uint64(4) * AREA] += weight * red
                    planes[at + lane + np.uint64(5) * AREA] += weight * green
                    planes[at + lane + np.uint64(6) * AREA] += weight * blue
            at += np.uint64(LANES)


@njit(**FAST_INLINE)
def _opaque(planes: Array, base: int) -> bool:
    """Whether every pixel of the tile is finished."""
    clearest = -_ONE
    for pixel in range(AREA):
        clearest = max(clearest, planes[base + pixel])
    return bool(clearest <= _ZERO)


@kernel(**FAST)
def composite(view: View, slab: Slab, tiles: Tiles, planes: Array, color: bool | None) -> int:
    """Blend a slab into all open tiles, nearest first, and close those that became opaque; return the open ones.

    Args:
        view: the camera.
        slab: projected and, with ``color``, shaded Gaussians.
        tiles: their lists.
        planes: (T * P * 256,) float32, from :func:`clear`.
        color: None skips the colour planes, at compile time.
    """
    columns = (view.width + TILE - 1) // TILE
    count = len(tiles.closed)
    stride = np.uint64(len(planes) // count)
    still_open = 0
    for tile in range(count):
        if tiles.closed[tile]:
            continue
        corner = (tile % columns * TILE, tile // columns * TILE)
        base = np.uint64(tile) * stride
        first, last = tiles.starts[tile], tiles.starts[tile + 1]
        for pair in range(first, last):
            _blend(planes, base, slab, tiles.pairs[pair], corner, color)
            if (pair - first) % LOOK == LOOK - 1 and _opaque(planes, base):
                break
        tiles.closed[tile] = _opaque(planes, base)
        still_open += 1 - tiles.closed[tile]
    return still_open


@kernel(**CACHED)
def clear(planes: Array, view: View, count: int) -> None:
    """Transmittance 1 and sums 0; pixels of the last tiles outside the image are finished from the start."""
    columns = (view.width + TILE - 1) // TILE
    grid = planes.reshape((count, -1, STRIPS, TILE, LANES))
    grid[:, 1:] = _ZERO
    for tile in range(count):
        left, top = tile % columns * TILE, tile // columns * TILE
        for strip in range(STRIPS):
            for row in range(TILE):
                for lane in range(LANES):
                    inside = left + strip * LANES + lane < view.width and top + row < view.height
                    grid[tile, 0, strip, row, lane] = _ONE if inside else -_ONE


@kernel(**CACHED)
def resolve(planes: Array, view: View, count: int, across: tuple[int, int], out: Outputs) -> None:
    """Tiles to the image's columns [first, end) over black; depth is NaN where it is undefined."""
    columns = (view.width + TILE - 1) // TILE
    grid = planes.reshape((count, -1, STRIPS, TILE, LANES))
    for y in range(view.height):
        for x in range(across[0], across[1]):
            tile = y // TILE * columns + x // TILE
            strip, row, lane = x % TILE // LANES, y % TILE, x % LANES
            alpha = _ONE - abs(grid[tile, 0, strip, row, lane])
            mean, median = grid[tile, 1, strip, row, lane] / alpha, grid[tile, 3, strip, row, lane]
            out.alpha[y, x], out.label[y, x] = alpha, grid[tile, 2, strip, row, lane]
            out.expected_depth[y, x] = mean if alpha >= _MIN_COVER else _UNDEFINED
            out.depth[y, x] = median if median > _ZERO else _UNDEFINED
            for channel in range(len(out.image)):
                out.image[channel, y, x] = min(grid[tile, 4 + channel, strip, row, lane], _ONE)
