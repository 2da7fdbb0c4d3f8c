"""``.splat`` files of web viewers: 32 bytes a Gaussian, colours and rotations in 8 bits, no harmonics."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..storage.files import check_size
from .columns import Columns, affordable_degree, drawable, sh_of_color
from .splats import Splats

COUNT_LIMIT = 20_000_000
RECORD = np.dtype([("means", "<f4", 3), ("scales", "<f4", 3), ("rgba", "u1", 4), ("quats", "u1", 4)])


def read_dot_splat(path: Path) -> Splats:
    """Gaussians of a ``.splat`` file; what is not finite is left out and counted, as in a PLY.

    Raises:
        InputError: the file is missing, empty, too large, no whole number of records, or more than 1 % of it would be
            left out.
    """
    check_size(path, sys.maxsize)  # what is too much is told in Gaussians
    size = path.stat().st_size
    if size == 0 or size % RECORD.itemsize:
        raise InputError(path, "size", f"expected records of {RECORD.itemsize} bytes, got {size} bytes")
    if size > COUNT_LIMIT * RECORD.itemsize:
        raise InputError(path, "size", f"expected at most {COUNT_LIMIT} Gaussians, got {size // RECORD.itemsize}")
    affordable_degree(path, size // RECORD.itemsize, 0)
    table = np.fromfile(path, RECORD)
    color = table["rgba"].astype(np.float32) / np.float32(255)
    with np.errstate(all="ignore"):  # what is not finite is counted, not warned of
        columns: Columns = {
            "means": table["means"],
            "log_scales": np.log(table["scales"]),
            "quats": (table["quats"].astype(np.float32) - 128) / 128,  # w, x, y, z
            "opacity": color[:, 3],
            "sh": sh_of_color(color[:, :3])[:, None],
        }
        return drawable(path, columns)
