"""Gaussian splats on the CPU: many cameras, one thread a camera, or a part of one where threads are left over.

Per camera: cull chunks and Gaussians, sort by depth, then slab by slab project, list by tile and composite, until
all are drawn or every tile is opaque.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ...computer.memory import affordable
from . import Array, Outputs
from .splat_composite import ALL_PLANES, DEPTH_PLANES, clear, composite, resolve
from .splat_cull import Settings, View, cull, make_view, sort_by_depth
from .splat_pack import Packed
from .splat_project import BOX, COLUMNS, LANES, PAIRS, RECORD, SLAB, TILE, Slab, Tiles, project_slab
from .splat_shade import shade_slab
from .splat_weight import weigh

CUT = 50_000  # Gaussians from which a view is worth cutting: two threads draw 10,000 no faster, 100,000 1.5 times
SAMPLE = 4096  # Gaussians that tell where to cut
SCRATCH_BYTES = 28  # of a thread, for each Gaussian


class Scratch(NamedTuple):
    """Memory one thread works in."""

    ids: Array  # (V + 1,) int32
    depths: Array  # (V + 1,) float32
    keys: Array  # (2, V + 1) uint64
    slab: Slab
    tiles: Tiles
    planes: Array  # (T * P * 256,) float32


class Part(NamedTuple):
    """Columns of tiles of one view that one thread draws."""

    view: int
    first: int
    end: int


def _parts(packed: Packed, views: list[View], threads: int) -> list[Part]:
    """Whole views; those that would leave threads idle at the end are cut into parts with as much to draw in each."""
    columns = -(-views[0].width // TILE)
    rest = len(views) % threads if len(packed.bounds) >= CUT else 0
    parts = [Part(i, 0, columns) for i in range(len(views) - rest)]
    for i in range(len(views) - rest, len(views)):
        edges = [0, *_edges(packed.bounds, views[i], threads // rest), columns]
        parts += [Part(i, first, end) for first, end in pairwise(edges) if first < end]
    return parts


def _edges(bounds: Array, view: View, pieces: int) -> list[int]:
    """Columns of tiles between which there are about as many Gaussians, (pieces - 1,)."""
    w2c = np.array(view.w2c)
    x, y, z = w2c[:, :3] @ bounds[:: max(1, len(bounds) // SAMPLE), :3].T + w2c[:, 3:]
    with np.errstate(all="ignore"):
        u, v = view.focal[0] * x / z + view.center[0], view.focal[1] * y / z + view.center[1]
    inside = (z > view.near) & (u >= 0) & (u < view.width) & (v >= 0) & (v < view.height)
    shares = np.arange(1, pieces) / pieces
    at = np.quantile(u[inside], shares) if inside.any() else shares * view.width
    return [round(float(edge) / TILE) for edge in at]


def scratch_bytes(gaussians: int, size: tuple[int, int], color: bool) -> int:
    """What a thread works in: lists of the Gaussians, and planes of the frame."""
    return SCRATCH_BYTES * gaussians + 4 * (ALL_PLANES if color else DEPTH_PLANES) * _tiles(size) * TILE**2


def _tiles(size: tuple[int, int]) -> int:
    return -(-size[0] // TILE) * -(-size[1] // TILE)


def _scratch(gaussians: int, size: tuple[int, int], planes: int) -> Scratch:
    tiles = _tiles(size)
    slab = Slab(
        np.empty((SLAB, RECORD), np.float32),
        np.empty((SLAB, BOX), np.int32),
        np.ones(COLUMNS * LANES, np.float32),
        *np.empty((2, LANES + 1), np.int32),
    )
    lists = (np.empty(tiles, np.uint8), np.empty(tiles + 1, np.int32), np.empty(tiles, np.int32))
    return Scratch(
        np.empty(gaussians + 1, np.int32),
        np.empty(gaussians + 1, np.float32),
        np.empty((2, gaussians + 1), np.uint64),
        slab,
        Tiles(*lists, np.empty(PAIRS + tiles, np.int32)),
        np.empty(tiles * planes * TILE * TILE, np.float32),
    )


def draw(packed: Packed, view: View, scratch: Scratch, out: Outputs, part: Part) -> None:
    """Render one part of a view into ``out``; without rows in ``out.image`` colour is not computed."""
    tiles = scratch.tiles
    grid = tiles.closed.reshape(-1, -(-view.width // TILE))  # closed tiles are left alone
    grid[:], grid[:, part.first : part.end] = 1, 0
    across = (part.first * TILE, min(part.end * TILE, view.width))
    count = cull(packed.bounds, packed.chunks, view, across, scratch.ids, scratch.depths)
    sort_by_depth(scratch.ids, scratch.depths, count, *scratch.keys)
    clear(scratch.planes, view, len(tiles.closed))
    color = True if len(out.image) else None
    done = 0
    while done < count:
        taken, kept = project_slab(packed.geometry, scratch.ids[done:count], view, scratch.slab, tiles)
        done += taken
        if color:
            shade_slab(packed.geometry, packed.sh, view, scratch.slab, kept)
        if composite(view, scratch.slab, tiles, scratch.planes, color) == 0:
            break
    resolve(scratch.planes, view, len(tiles.closed), across, out)


def render(packed: Packed, views: list[View], color: bool, threads: int) -> Outputs:
    """Render views of one size.

    Args:
        packed: the Gaussians.
        views: B cameras of one size.
        color: whether the image is wanted; without it SH and colour planes are skipped.
        threads: at most so many work at once, fewer where memory is short; the result does not depend on it.

    Returns:
        Buffers with a leading axis B.
    """
    size = (views[0].width, views[0].height)
    shape = (len(views), size[1], size[0])
    frames = 4 * (7 if color else 4) * len(views) * size[0] * size[1]
    threads = affordable(threads, scratch_bytes(len(packed.bounds), size, color), frames)
    out = Outputs(
        np.empty((shape[0], 3 if color else 0, *shape[1:]), np.float32),
        *(np.empty(shape, np.float32) for _ in range(4)),
    )
    parts = _parts(packed, views, threads)
    work, workers = iter(parts), min(threads, len(parts))
    if workers == 1:
        _work(work, packed, views, out)
        return out
    with ThreadPoolExecutor(workers) as pool:
        for task in [pool.submit(_work, work, packed, views, out) for _ in range(workers)]:
            task.result()
    return out


def _work(parts: Iterator[Part], packed: Packed, views: list[View], out: Outputs) -> None:
    """Draw from a queue that threads share."""
    planes = ALL_PLANES if out.image.shape[1] else DEPTH_PLANES
    scratch = _scratch(len(packed.bounds), (views[0].width, views[0].height), planes)
    for part in parts:
        draw(packed, views[part.view], scratch, Outputs(*(buffer[part.view] for buffer in out)), part)


def weights(packed: Packed, views: list[View]) -> Array:
    """Greatest share of a pixel that each packed Gaussian has in any of ``views``, (V,) float32 in [0, 1]."""
    out = np.zeros(len(packed.bounds), np.float32)
    for view in views:
        scratch = _scratch(len(packed.bounds), (view.width, view.height), DEPTH_PLANES)
        tiles, transmittance = scratch.tiles, np.ones((view.height, view.width), np.float32)
        count = cull(packed.bounds, packed.chunks, view, (0, view.width), scratch.ids, scratch.depths)
        sort_by_depth(scratch.ids, scratch.depths, count, *scratch.keys)
        tiles.closed[:] = 0
        done = 0
        while done < count:
            taken, _ = project_slab(packed.geometry, scratch.ids[done:count], view, scratch.slab, tiles)
            done += taken
            if weigh(view, scratch.slab, tiles, transmittance, out) == 0:
                break
    return out


def count_visible(packed: Packed, view: View) -> int:
    """How many Gaussians can touch the frame, for tables."""
    n = len(packed.bounds)
    ids, depths = np.empty(n + 1, np.int32), np.empty(n + 1, np.float32)
    return cull(packed.bounds, packed.chunks, view, (0, view.width), ids, depths)


__all__ = ["Packed", "Settings", "View", "count_visible", "make_view", "render", "weights"]
