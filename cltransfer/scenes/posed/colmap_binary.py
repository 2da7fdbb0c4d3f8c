"""COLMAP's binary encoding: cameras.bin, images.bin and, where there is one, points3D.bin; all little-endian."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from ...computer.array_type import Array
from ...errors import InputError
from ..meshes.asset_files import read_limited
from .assemble import IMAGE_LIMIT, POINT_LIMIT, check_points
from .colmap_tables import MODELS, STRAIGHTEN, Calibration, Shot, Tables

BYTE_LIMIT = 2**30
NAME_LIMIT = 4096


class _Reader:
    """Values one after the other from the bytes of a file; its end is an error, not a short value."""

    def __init__(self, path: Path) -> None:
        self.path, self.data, self.at = path, read_limited(path, BYTE_LIMIT), 0

    def take(self, form: str) -> tuple:
        """Values of ``form`` in the notation of struct."""
        try:
            values = struct.unpack_from("<" + form, self.data, self.at)
        except struct.error:
            raise self.cut_off() from None
        self.at += struct.calcsize("<" + form)
        return values

    def count(self, what: str, limit: int) -> int:
        """A number of rows, at most ``limit``."""
        (count,) = self.take("Q")
        if count > limit:
            raise InputError(self.path, what, f"expected at most {limit}, got {count}")
        return count

    def skip(self, size: int) -> None:
        """Leave out ``size`` bytes."""
        self.at += size
        if self.at > len(self.data):
            raise self.cut_off()

    def text(self) -> str:
        """A name that ends with a zero."""
        end = self.data.find(b"\0", self.at, self.at + NAME_LIMIT)
        if end < 0:
            raise self.cut_off()
        name, self.at = self.data[self.at : end], end + 1
        return name.decode("utf-8", "replace")

    def cut_off(self) -> InputError:
        """What to raise where the bytes end too early."""
        return InputError(self.path, "body", f"cut off: {len(self.data)} bytes are too few for what it announces")


def read_tables(model: Path) -> Tables:
    """The model in the folder ``model``.

    Raises:
        InputError: a file is missing, too large or cut off, or a lens has an unknown number.
        ResourceError: a file or its points take more memory than is free.
    """
    points = model / "points3D.bin"
    empty = np.empty((0, 3)), np.empty((0, 3), np.uint8)
    return Tables(
        _cameras(_Reader(model / "cameras.bin")),
        _images(_Reader(model / "images.bin")),
        *(_points(_Reader(points)) if points.is_file() else empty),
    )


def _cameras(file: _Reader) -> dict[int, Calibration]:
    cameras = {}
    for _ in range(file.count("cameras", IMAGE_LIMIT)):
        key, number, width, height = file.take("IiQQ")
        if number not in MODELS:
            raise InputError(file.path, f"camera {key}", f"lens model {number} is not known here", STRAIGHTEN)
        name, parameters = MODELS[number]
        cameras[key] = Calibration(name, (width, height), file.take(f"{parameters}d"))
    return cameras


def _images(file: _Reader) -> list[Shot]:
    shots = []
    for _ in range(file.count("images", IMAGE_LIMIT)):
        _, *pose, camera = file.take("I7dI")
        name = file.text()
        (seen,) = file.take("Q")
        file.skip(24 * seen)  # x, y and the id of each point it sees
        shots.append(Shot(name, np.array(pose[:4]), np.array(pose[4:]), camera))
    return shots


def _points(file: _Reader) -> tuple[Array, Array]:
    count = file.count("points", POINT_LIMIT)
    if 51 * count > len(file.data):  # bytes of a point that no image sees
        raise file.cut_off()
    check_points(file.path, count)
    points, colors = np.empty((count, 3)), np.empty((count, 3), np.uint8)
    for row in range(count):
        _, *values, _, seen = file.take("Q3d3BdQ")
        points[row], colors[row] = values[:3], values[3:]
        file.skip(8 * seen)
    return points, colors
