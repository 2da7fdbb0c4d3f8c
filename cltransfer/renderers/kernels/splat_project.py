"""Gaussians to ellipses on the image, and ellipses to the tiles they touch."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from ...computer.compiled import kernel
from . import CACHED, INLINE, Array, f32
from .splat_cull import LOW_PASS, View
from .splat_pack import COVARIANCE, LABEL, MIN_ALPHA, OPACITY, RADIUS

TILE = 16  # [px], side of a tile
SLAB = 8192  # Gaussians projected at a time, so that their records stay in the L2 cache
PAIRS = 8 * SLAB  # (Gaussian, tile) pairs in a slab
AHEAD = 12  # Gaussians between prefetch and use
LANES = 128  # Gaussians that are projected together
MAX_DETERMINANT = 1e37  # [px^4]; beyond it float32 overflows
# columns of a record
U, V, QA, QB, QC, PEAK, DEPTH, MEMBER, RED, GREEN, BLUE, RECORD = range(12)
# columns of a box: first and last pixel, and the Gaussian's row
X0, X1, Y0, Y1, SOURCE, BOX = range(6)

# where the lanes of a column begin: of a geometry row, then of what is made of it
GATHERED, COLUMNS = OPACITY + 1, 23
_LANES = np.uint64(LANES)
_PX, _PY, _PZ, _XX, _XY, _XZ, _YY, _YZ, _ZZ, _OPACITY = (np.uint64(LANES * column) for column in range(GATHERED))
_U, _V, _Z, _EXX, _EXY, _EYY, _SHRINK, _PEAK, _REACH, _X0, _X1, _Y0, _Y1 = (
    np.uint64(LANES * column) for column in range(GATHERED, COLUMNS)
)

_LOW_PASS, _MIN_ALPHA = f32(LOW_PASS), f32(MIN_ALPHA)
_ZERO, _HALF, _ONE, _TWO = f32(0), f32(0.5), f32(1), f32(2)
_MIN_COMPENSATION = f32(2.5e-5)  # of det / blurred det; gsplat has none
_MAX_DETERMINANT = f32(MAX_DETERMINANT)


class Slab(NamedTuple):
    """Projected Gaussians of one depth range, nearest first."""

    records: Array  # (SLAB, RECORD) float32
    boxes: Array  # (SLAB, BOX) int32
    lanes: Array  # (COLUMNS * LANES,) float32, scratch
    chosen: Array  # (LANES + 1,) int32, scratch: rows
    places: Array  # (LANES + 1,) int32, scratch: where they came


class Tiles(NamedTuple):
    """The slab's Gaussians by tile: ``pairs[starts[t]:starts[t + 1]]`` are tile t's, nearest first."""

    closed: Array  # (T,) uint8, 1 where every pixel is opaque
    starts: Array  # (T + 1,) int32
    cursor: Array  # (T,) int32, scratch
    pairs: Array  # (PAIRS + T,) int32, so that one Gaussian always fits


@intrinsic(prefer_literal=True)
def prefetch(typing_context, rows, index, lines):  # type: ignore[no-untyped-def]  # numba's own protocol
    """Ask for the first ``lines`` cache lines of ``rows[index]``, a row-major 2D array, before they are needed."""

    def generate(context, builder, signature, values):  # type: ignore[no-untyped-def]
        array = context.make_array(rows)(context, builder, values[0])
        stride = cgutils.unpack_tuple(builder, array.strides, 2)[0]
        address = builder.add(builder.ptrtoint(array.data, stride.type), builder.mul(values[1], stride))
        for line in range(lines.literal_value):
            pointer = builder.inttoptr(builder.add(address, stride.type(64 * line)), cgutils.voidptr_t)
            flag = cgutils.int32_t
            function = cgutils.get_or_insert_function(
                builder.module, cgutils.ir.FunctionType(cgutils.ir.VoidType(), [cgutils.voidptr_t, flag, flag, flag]),
                "llvm.prefetch.p0",
            )  # fmt: skip
            builder.call(function, [pointer, flag(0), flag(3), flag(1)])  # read, keep, data
        return context.get_dummy_value()

    return types.void(rows, types.intp, lines), generate


@njit(**INLINE)
def _clip(value: f32, low: f32, high: f32) -> f32:
    return low if value < low else (high if value > high else value)


@njit(**INLINE)
def _to_camera(lanes: Array, k: np.uint64, view: View) -> tuple[f32, f32, f32]:
    """Mean of lane k in camera axes."""
    m, px, py, pz = view.w2c, lanes[_PX + k], lanes[_PY + k], lanes[_PZ + k]
    x = m[0][0] * px + m[0][1] * py + m[0][2] * pz + m[0][3]
    y = m[1][0] * px + m[1][1] * py + m[1][2] * pz + m[1][3]
    return x, y, m[2][0] * px + m[2][1] * py + m[2][2] * pz + m[2][3]


@njit(**INLINE)
def _ellipse(lanes: Array, k: np.uint64, point: tuple[f32, f32, f32], view: View) -> tuple[f32, f32, f32]:
    """Image covariance xx, xy, yy [px^2] of lane k at camera coordinates (EWA splatting, Zwicker 2002)."""
    x, y, z = point
    m, inverse = view.w2c, _ONE / z
    tx = _clip(x * inverse, view.tangent_low[0], view.tangent_high[0])
    ty = _clip(y * inverse, view.tangent_low[1], view.tangent_high[1])
    jx, jy = view.focal[0] * inverse, view.focal[1] * inverse
    a0, a1, a2 = jx * (m[0][0] - tx * m[2][0]), jx * (m[0][1] - tx * m[2][1]), jx * (m[0][2] - tx * m[2][2])
    b0, b1, b2 = jy * (m[1][0] - ty * m[2][0]), jy * (m[1][1] - ty * m[2][1]), jy * (m[1][2] - ty * m[2][2])
    xx, xy, xz = lanes[_XX + k], lanes[_XY + k], lanes[_XZ + k]
    yy, yz, zz = lanes[_YY + k], lanes[_YZ + k], lanes[_ZZ + k]
    s0, s1, s2 = xx * a0 + xy * a1 + xz * a2, xy * a0 + yy * a1 + yz * a2, xz * a0 + yz * a1 + zz * a2
    r0, r1, r2 = xx * b0 + xy * b1 + xz * b2, xy * b0 + yy * b1 + yz * b2, xz * b0 + yz * b1 + zz * b2
    return a0 * s0 + a1 * s1 + a2 * s2, b0 * s0 + b1 * s1 + b2 * s2, b0 * r0 + b1 * r1 + b2 * r2


@njit(**INLINE)
def _pixels(middle: f32, reach: f32, size: int) -> tuple[f32, f32]:
    """First and last pixel whose centre is within ``reach`` of ``middle``; first > last where none is, or no number."""
    limit = f32(size)
    low, high = np.ceil(middle - reach - _HALF), np.floor(middle + reach - _HALF)
    some = low <= high
    return (_clip(low, _ZERO, limit) if some else limit), (_clip(high, -_ONE, limit - _ONE) if some else -_ONE)


@njit(**INLINE)
def _gather(geometry: Array, rows: Array, count: int, columns: int, lanes: Array) -> None:
    """Columns of the first ``count`` rows, one row a lane."""
    for k in range(count):
        if k + AHEAD < len(rows):
            prefetch(geometry, rows[k + AHEAD], 1)  # type: ignore[call-arg]  # numba adds the first
        row = rows[k]
        for column in range(columns):
            lanes[column * LANES + k] = geometry[row, column]


@njit(**INLINE)
def _ellipses(lanes: Array, view: View) -> None:
    """Ellipse, peak and place of every lane; its peak is 0 where it leaves no trace on the image."""
    for k in range(_LANES):  # no branches, unit stride: becomes vector instructions
        x, y, z = _to_camera(lanes, k, view)
        xx, xy, yy = _ellipse(lanes, k, (x, y, z), view)
        sharp = xx * yy - xy * xy
        xx, yy = xx + _LOW_PASS, yy + _LOW_PASS
        determinant = xx * yy - xy * xy
        inverse, shrink = _ONE / z, _ONE / determinant
        peak = lanes[_OPACITY + k] * _clip((z - view.near) * view.fade_rate, _ZERO, _ONE)
        if view.antialiased:
            peak *= np.sqrt(_clip(sharp * shrink, _MIN_COMPENSATION, _ONE))
        there = (determinant > _ZERO) & (determinant < _MAX_DETERMINANT) & (peak > _MIN_ALPHA)
        lanes[_PEAK + k] = peak if there else _ZERO
        lanes[_U + k] = view.focal[0] * x * inverse + view.center[0]
        lanes[_V + k] = view.focal[1] * y * inverse + view.center[1]
        lanes[_Z + k] = z
        lanes[_EXX + k], lanes[_EXY + k], lanes[_EYY + k], lanes[_SHRINK + k] = xx, xy, yy, shrink


@njit(**INLINE)
def _boxes(lanes: Array, count: int, view: View) -> None:
    """First and last pixels of every lane, in standard deviations where its alpha falls to 1/255."""
    for k in range(count):
        peak = lanes[_PEAK + k]
        lanes[_REACH + k] = _TWO * np.log(peak / _MIN_ALPHA) if peak > _ZERO else _ZERO  # squared
    for k in range(_LANES):
        reach = lanes[_REACH + k]
        across, down = np.sqrt(reach * lanes[_EXX + k]), np.sqrt(reach * lanes[_EYY + k])
        lanes[_X0 + k], lanes[_X1 + k] = _pixels(lanes[_U + k], across, view.width)
        lanes[_Y0 + k], lanes[_Y1 + k] = _pixels(lanes[_V + k], down, view.height)


@njit(**INLINE)
def _record(geometry: Array, row: int, lanes: Array, lane: int, slab: Slab, k: int) -> bool:
    """Fill slot k of the slab with a lane, which is ``row``; false where it leaves no trace on the image."""
    record, box = slab.records, slab.boxes
    if lanes[_PEAK + lane] <= _ZERO:
        return False
    box[k, X0], box[k, X1] = int(lanes[_X0 + lane]), int(lanes[_X1 + lane])
    box[k, Y0], box[k, Y1], box[k, SOURCE] = int(lanes[_Y0 + lane]), int(lanes[_Y1 + lane]), row
    shrink = lanes[_SHRINK + lane]
    record[k, U], record[k, V], record[k, DEPTH] = lanes[_U + lane], lanes[_V + lane], lanes[_Z + lane]
    record[k, QA], record[k, QB] = -_HALF * lanes[_EYY + lane] * shrink, lanes[_EXY + lane] * shrink
    record[k, QC] = -_HALF * lanes[_EXX + lane] * shrink
    record[k, PEAK], record[k, MEMBER] = lanes[_PEAK + lane], geometry[row, LABEL]
    return box[k, X0] <= box[k, X1] and box[k, Y0] <= box[k, Y1]


@njit(**INLINE)
def _count_open(box: Array, k: int, tiles: Tiles, columns: int) -> int:
    """Add one to each open tile the box touches; return how many there were."""
    hits = 0
    for ty in range(box[k, Y0] // TILE, box[k, Y1] // TILE + 1):
        for tx in range(box[k, X0] // TILE, box[k, X1] // TILE + 1):
            tile = ty * columns + tx
            if tiles.closed[tile] == 0:
                tiles.starts[tile + 1] += 1
                hits += 1
    return hits


@njit(**INLINE)
def _reaches(geometry: Array, rows: Array, count: int, view: View, lanes: Array) -> None:
    """First and last pixels that the next ``count`` rows could touch at most; cheaper than projecting them."""
    _gather(geometry, rows, count, COVARIANCE, lanes)
    for k in range(count):
        lanes[_REACH + k] = geometry[rows[k], RADIUS]
    low, high = view.tangent_low, view.tangent_high
    wide = max(max(-low[0], high[0]), max(-low[1], high[1]))
    widen = max(view.focal[0], view.focal[1]) * np.sqrt(_ONE + wide * wide)
    for k in range(_LANES):
        x, y, z = _to_camera(lanes, k, view)
        inverse = _ONE / z
        u, v = view.focal[0] * x * inverse + view.center[0], view.focal[1] * y * inverse + view.center[1]
        reach = lanes[_REACH + k] * (widen * inverse) + _TWO
        lanes[_X0 + k], lanes[_X1 + k] = _pixels(u, reach, view.width)
        lanes[_Y0 + k], lanes[_Y1 + k] = _pixels(v, reach, view.height)
        lanes[_REACH + k] = reach


@njit(**INLINE)
def _hidden(lanes: Array, k: int, tiles: Tiles, columns: int) -> bool:
    """Whether every tile a small Gaussian could touch is closed."""
    if not lanes[_REACH + k] < f32(2 * TILE):
        return False
    first_x, last_x = int(lanes[_X0 + k]) // TILE, int(lanes[_X1 + k]) // TILE
    for ty in range(int(lanes[_Y0 + k]) // TILE, int(lanes[_Y1 + k]) // TILE + 1):
        for tx in range(first_x, last_x + 1):
            if tiles.closed[ty * columns + tx] == 0:
                return False
    return True


@njit(**INLINE)
def _open(geometry: Array, rows: Array, view: View, slab: Slab, tiles: Tiles, columns: int) -> tuple[int, int]:
    """The next rows that are not :func:`_hidden`, a block at most; how many were looked at, how many they are."""
    count, chosen = min(LANES, len(rows)), 0
    _reaches(geometry, rows, count, view, slab.lanes)
    for k in range(count):
        slab.chosen[chosen], slab.places[chosen] = rows[k], k
        chosen += int(not _hidden(slab.lanes, k, tiles, columns))
    return count, chosen


@kernel(**CACHED)
def project_slab(geometry: Array, order: Array, view: View, slab: Slab, tiles: Tiles) -> tuple[int, int]:
    """Project the next Gaussians until the slab is full, list them by tile; return how many were taken and kept.

    Args:
        geometry: (V, 16), see :class:`~cltransfer.renderers.kernels.splat_pack.Packed`.
        order: rows that are still to come, nearest first, (R,) int32.
        view: the camera.
        slab: out.
        tiles: in: which are closed; out: the lists.
    """
    columns = (view.width + TILE - 1) // TILE
    tiles.starts[:] = 0
    taken, kept, pairs = 0, 0, 0
    any_closed = tiles.closed.any()
    while taken < len(order) and kept < SLAB and pairs + len(tiles.closed) <= len(tiles.pairs):
        rows = order[taken:]
        looked = count = min(LANES, len(rows))
        if any_closed:
            looked, count = _open(geometry, rows, view, slab, tiles, columns)
            rows = slab.chosen
        _gather(geometry, rows, count, GATHERED, slab.lanes)
        _ellipses(slab.lanes, view)
        _boxes(slab.lanes, count, view)
        for k in range(count):
            if kept == SLAB or pairs + len(tiles.closed) > len(tiles.pairs):
                looked = slab.places[k] if any_closed else k
                break
            if _record(geometry, rows[k], slab.lanes, k, slab, kept):
                hits = _count_open(slab.boxes, kept, tiles, columns)
                pairs += hits
                kept += int(hits > 0)
        taken += looked
    _list_by_tile(kept, slab, tiles, columns)
    return taken, kept


@njit(**INLINE)
def _list_by_tile(kept: int, slab: Slab, tiles: Tiles, columns: int) -> None:
    """Counting sort of the slab's records by tile; depth order is kept."""
    for tile in range(len(tiles.closed)):
        tiles.starts[tile + 1] += tiles.starts[tile]
        tiles.cursor[tile] = tiles.starts[tile]
    box = slab.boxes
    for k in range(kept):
        for ty in range(box[k, Y0] // TILE, box[k, Y1] // TILE + 1):
            for tx in range(box[k, X0] // TILE, box[k, X1] // TILE + 1):
                tile = ty * columns + tx
                if tiles.closed[tile] == 0:
                    tiles.pairs[tiles.cursor[tile]] = k
                    tiles.cursor[tile] += 1
