"""Coloured points of a PLY, as reconstructions are kept beside their images."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from plyfile import PlyData, PlyParseError

from ...errors import InputError
from ...renderers.kernels import Array
from ..ply_header import check_header

POSITION, COLOR = ("x", "y", "z"), ("red", "green", "blue")


def read_points(path: Path) -> tuple[Array, Array | None]:
    """Points (P, 3) float64 and their RGB (P, 3) uint8, None where the file has none.

    Raises:
        InputError: the file is no binary PLY of points, is damaged, or a point is not finite.
    """
    types = check_header(path)["vertex"].types if "vertex" in check_header(path) else {}
    if not set(POSITION) <= set(types):
        raise InputError(path, "property x, y, z", "is missing", "is it a PLY of points?")
    try:
        table = PlyData.read(str(path), mmap="r")["vertex"].data
    except (PlyParseError, ValueError, UnicodeDecodeError) as error:
        raise InputError(path, "header", f"not readable: {error}") from None
    points = np.stack([table[name] for name in POSITION], axis=1).astype(np.float64)
    if not np.isfinite(points).all():
        raise InputError(path, "property x, y, z", "expected finite numbers")
    if any(types.get(name) not in ("uchar", "uint8") for name in COLOR):
        return points, None
    return points, np.stack([table[name] for name in COLOR], axis=1)
