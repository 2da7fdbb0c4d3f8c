"""Gaussian splats on the CPU: many cameras, one thread a camera.

Per camera: cull chunks and Gaussians, sort by depth, then slab by slab project, list by tile and composite, until
all are drawn or every tile is opaque.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from . import Array
from .splat_composite import ALL_PLANES, DEPTH_PLANES, Outputs, clear, composite, resolve
from .splat_cull import Settings, View, cull, make_view, sort_by_depth
from .splat_pack import Packed
from .splat_project import BOX, PAIRS, RECORD, SLAB, TILE, Slab, Tiles, project_slab
from .splat_shade import shade_slab
from .splat_weight import weigh


class Scratch(NamedTuple):
    """Memory one thread works in."""

    ids: Array  # (V + 1,) int32
    depths: Array  # (V + 1,) float32
    keys: Array  # (2, V + 1) uint64
    slab: Slab
    tiles: Tiles
    planes: Array  # (T * P * 256,) float32


def _scratch(gaussians: int, size: tuple[int, int], planes: int) -> Scratch:
    tiles = -(-size[0] // TILE) * -(-size[1] // TILE)
    slab = Slab(np.empty((SLAB, RECORD), np.float32), np.empty((SLAB, BOX), np.int32))
    lists = (np.empty(tiles, np.uint8), np.empty(tiles + 1, np.int32), np.empty(tiles, np.int32))
    return Scratch(
        np.empty(gaussians + 1, np.int32),
        np.empty(gaussians + 1, np.float32),
        np.empty((2, gaussians + 1), np.uint64),
        slab,
        Tiles(*lists, np.empty(PAIRS + tiles, np.int32)),
        np.empty(tiles * planes * TILE * TILE, np.float32),
    )


def draw(packed: Packed, view: View, scratch: Scratch, out: Outputs) -> None:
    """Render one view into ``out``; without rows in ``out.image`` colour is not computed."""
    tiles = scratch.tiles
    count = cull(packed.bounds, packed.chunks, view, scratch.ids, scratch.depths)
    sort_by_depth(scratch.ids, scratch.depths, count, *scratch.keys)
    clear(scratch.planes, view, len(tiles.closed))
    tiles.closed[:] = 0
    color = True if len(out.image) else None
    done = 0
    while done < count:
        taken, kept = project_slab(packed.geometry, scratch.ids[done:count], view, scratch.slab, tiles)
        done += taken
        if color:
            shade_slab(packed.geometry, packed.sh, view, scratch.slab, kept)
        if composite(view, scratch.slab, tiles, scratch.planes, color) == 0:
            break
    resolve(scratch.planes, view, len(tiles.closed), out)


def render(packed: Packed, views: list[View], color: bool, threads: int) -> Outputs:
    """Render views of one size.

    Args:
        packed: the Gaussians.
        views: B cameras of one size.
        color: whether the image is wanted; without it SH and colour planes are skipped.
        threads: at most so many work at once; the result does not depend on it.

    Returns:
        Buffers with a leading axis B.
    """
    size = (views[0].width, views[0].height)
    shape = (len(views), size[1], size[0])
    out = Outputs(
        np.empty((shape[0], 3 if color else 0, *shape[1:]), np.float32),
        *(np.empty(shape, np.float32) for _ in range(4)),
    )
    work = iter(range(len(views)))
    workers = min(threads, len(views))
    if workers == 1:
        _work(work, packed, views, out)
        return out
    with ThreadPoolExecutor(workers) as pool:
        for task in [pool.submit(_work, work, packed, views, out) for _ in range(workers)]:
            task.result()
    return out


def _work(indices: Iterator[int], packed: Packed, views: list[View], out: Outputs) -> None:
    """Draw views from a queue that threads share."""
    planes = ALL_PLANES if out.image.shape[1] else DEPTH_PLANES
    scratch = _scratch(len(packed.bounds), (views[0].width, views[0].height), planes)
    for i in indices:
        draw(packed, views[i], scratch, Outputs(*(buffer[i] for buffer in out)))


def weights(packed: Packed, views: list[View]) -> Array:
    """Greatest share of a pixel that each packed Gaussian has in any of ``views``, (V,) float32 in [0, 1]."""
    out = np.zeros(len(packed.bounds), np.float32)
    for view in views:
        scratch = _scratch(len(packed.bounds), (view.width, view.height), DEPTH_PLANES)
        tiles, transmittance = scratch.tiles, np.ones((view.height, view.width), np.float32)
        count = cull(packed.bounds, packed.chunks, view, scratch.ids, scratch.depths)
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
    return cull(packed.bounds, packed.chunks, view, np.empty(n + 1, np.int32), np.empty(n + 1, np.float32))


__all__ = ["Packed", "Settings", "View", "count_visible", "make_view", "render", "weights"]
