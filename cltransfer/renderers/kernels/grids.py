"""Voxel grids on the CPU: many cameras, one thread a camera."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from . import Outputs
from .grid_march import Settings, View, make_view, march
from .grid_pack import Packed


def render(packed: Packed, views: list[View], buffers: frozenset[str], threads: int) -> Outputs:
    """Render views of one size.

    Args:
        packed: the grid.
        views: B cameras of one size.
        buffers: which fields of the outputs are wanted; the others get no rows and cost nothing.
        threads: at most so many work at once; the result does not depend on it.

    Returns:
        Buffers with a leading axis B.
    """
    shape = (views[0].height, views[0].width)
    leading = {name: (3, *shape) if name == "image" else shape for name in Outputs._fields}
    rows = {name: size if name in buffers else (0, *size[1:]) for name, size in leading.items()}
    out = Outputs(*(np.empty((len(views), *rows[name]), np.float32) for name in Outputs._fields))
    parts = [Outputs(*(buffer[i] for buffer in out)) for i in range(len(views))]
    with ThreadPoolExecutor(min(threads, len(views))) as pool:
        list(pool.map(march, [packed] * len(views), views, parts))
    return out


__all__ = ["Outputs", "Packed", "Settings", "View", "make_view", "render"]
