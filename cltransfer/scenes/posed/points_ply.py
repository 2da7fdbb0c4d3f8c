"""Coloured points of a PLY, as reconstructions are kept beside their images: binary, or text as of nerfstudio."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from plyfile import PlyData, PlyParseError

from ...computer.array_type import Array
from ...errors import InputError
from ..meshes.asset_files import read_limited
from ..meshes.mesh_need import check_ply
from ..ply_header import HEADER_LIMIT, check_header
from .assemble import check_points

POSITION, COLOR = ("x", "y", "z"), ("red", "green", "blue")


def read_points(path: Path) -> tuple[Array, Array | None]:
    """Points (P, 3) float64 and their RGB (P, 3) uint8, None where the file has none.

    Raises:
        InputError: the file is no PLY of points, is damaged, or a point is not finite.
        ResourceError: it takes more memory than is free.
    """
    if _is_text(path):
        check_ply(path, read_limited(path))
    else:
        check_header(path)
    try:
        tables = PlyData.read(str(path), mmap="r")
    except (PlyParseError, ValueError, OverflowError) as error:  # a text that cannot be decoded is a ValueError
        raise InputError(path, "", f"not readable: {' '.join(str(error).split())[:120]}") from None
    rows = tables["vertex"].data if "vertex" in tables else np.empty(0, [("none", np.uint8)])
    types = {name: rows.dtype[name] for name in rows.dtype.names or ()}
    if any(name not in types or types[name].kind not in "iuf" for name in POSITION):
        raise InputError(path, "property x, y, z", "is missing", "is it a PLY of points?")
    check_points(path, len(rows))
    points = np.stack([rows[name] for name in POSITION], axis=1).astype(np.float64)
    if not np.isfinite(points).all():
        raise InputError(path, "property x, y, z", "expected finite numbers")
    if any(types.get(name) != np.uint8 for name in COLOR):
        return points, None
    return points, np.stack([rows[name] for name in COLOR], axis=1)


def _is_text(path: Path) -> bool:
    """Whether a PLY says that its numbers are written out; False too where it is no PLY, which its reader reports."""
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        lines = stream.read(HEADER_LIMIT).splitlines()
    return lines[:1] == [b"ply"] and lines[1:2] == [b"format ascii 1.0"]
