"""COLMAP's text encoding: cameras.txt, images.txt and, where there is one, points3D.txt."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ...computer.array_type import Array
from ...errors import InputError
from ...storage.files import read_lines
from .assemble import IMAGE_LIMIT, POINT_LIMIT, check_points
from .colmap_tables import COUNTS, STRAIGHTEN, Calibration, Shot, Tables

BYTE_LIMIT = 2**30
LINE_LIMIT = 2**24  # characters; an image lists in one line all the points it sees
ID_DIGITS = 20  # of 64 bits, more than COLMAP gives a camera


def read_tables(model: Path) -> Tables:
    """The model in the folder ``model``.

    Raises:
        InputError: a file is missing or too large, or a line is not what it should be.
        ResourceError: its points take more memory than is free.
    """
    points = model / "points3D.txt"
    empty = np.empty((0, 3)), np.empty((0, 3), np.uint8)
    return Tables(
        _cameras(model / "cameras.txt"),
        _images(model / "images.txt"),
        *(_points(points) if points.is_file() else empty),
    )


def _lines(path: Path) -> Iterator[tuple[str, str]]:
    """Where each line stands, and the line; comments are left out, empty lines are not."""
    for number, line in enumerate(read_lines(path, BYTE_LIMIT, LINE_LIMIT), start=1):
        if not line.startswith("#"):
            yield f"line {number}", line


def _numbers(path: Path, where: str, parts: list[str]) -> Array:
    try:
        return np.array(parts, np.float64)
    except ValueError:
        raise InputError(path, where, "expected numbers") from None


def _is_id(text: str) -> bool:
    return text.isdecimal() and len(text) <= ID_DIGITS


def _cameras(path: Path) -> dict[int, Calibration]:
    cameras: dict[int, Calibration] = {}
    for where, line in _lines(path):
        if not line.strip():
            continue
        key, model, *rest = [*line.split(), "", ""]
        values = _numbers(path, where, rest[:-2])
        if _is_id(key) and model.isupper() and model not in COUNTS:
            raise InputError(path, where, f"lens model {model[:40]} is not known here", STRAIGHTEN)
        if not _is_id(key) or model not in COUNTS or len(values) != 2 + COUNTS[model]:
            raise InputError(path, where, "expected CAMERA_ID MODEL WIDTH HEIGHT and the model's parameters")
        cameras[int(key)] = Calibration(model, (float(values[0]), float(values[1])), tuple(values[2:].tolist()))
        if len(cameras) > IMAGE_LIMIT:
            raise InputError(path, "cameras", f"expected at most {IMAGE_LIMIT}")
    return cameras


def _images(path: Path) -> list[Shot]:
    shots: list[Shot] = []
    lines = _lines(path)
    for where, line in lines:
        if not line.strip():
            continue
        there, seen = next(lines, (where, ""))  # the points that the image sees: a line that may be empty
        if len(seen.split()) % 3:
            reason = "expected X Y POINT3D_ID of the points that the image before it sees, or an empty line"
            raise InputError(path, there, reason, "were empty lines left out?")
        parts = line.split(maxsplit=9)
        if len(parts) != 10 or not _is_id(parts[8]):
            raise InputError(path, where, "expected IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME")
        pose = _numbers(path, where, parts[1:8])
        shots.append(Shot(parts[9].strip(), pose[:4], pose[4:], int(parts[8])))
        if len(shots) > IMAGE_LIMIT:
            raise InputError(path, "images", f"expected at most {IMAGE_LIMIT}")
    return shots


def _points(path: Path) -> tuple[Array, Array]:
    values = array("d")
    for where, line in _lines(path):
        if line.strip():
            row = _numbers(path, where, line.split(maxsplit=7)[1:7])
            if len(row) != 6:
                raise InputError(path, where, "expected POINT3D_ID X Y Z R G B ERROR")
            values.extend(row)
            if len(values) > 6 * POINT_LIMIT:
                raise InputError(path, "points", f"expected at most {POINT_LIMIT}")
    check_points(path, len(values) // 6)
    table = np.array(values).reshape(-1, 6)
    return table[:, :3], _colors(path, table[:, 3:])


def _colors(path: Path, values: Array) -> Array:
    """RGB (P, 3) uint8 of what the lines say, refused where it is no colour."""
    wrong = ~((values >= 0) & (values <= 255)).all(axis=1)
    if wrong.any():
        index = int(wrong.argmax())
        told = " ".join(f"{value:g}" for value in values[index])
        raise InputError(path, f"point {index + 1}", f"expected R G B of 0 to 255, got {told}")
    return values.astype(np.uint8)
