"""A PLY mesh of triangles alone: of a polygon trimesh makes a fan, and unlike ones of a binary file it cannot read."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from ...computer.array_type import Array
from ...errors import InputError
from ..ply_header import header_of
from .ply_remarks import AsciiHeader, in_utf8, with_remarks
from .polygons import fan_of, fans_hold, triangles_of

CORNERS = ("vertex_indices", "vertex_index")
PLACES = "texcoord"  # of the corners of each face, in the texture
AXES = ("x", "y", "z")


def of_triangles(path: Path, data: bytes) -> bytes:
    """The file as it is if its faces are triangles, else with triangles in place of each polygon.

    What a polygon has, as its colour, all of its triangles have. A header that is no UTF-8 becomes it.

    Args:
        path: for error lines.
        data: with a sound header, see :func:`.mesh_need.check_ply`.

    Raises:
        InputError: a polygon names a vertex that is not there, or has one number in place of a list.
    """
    from plyfile import PlyData, PlyElement, PlyParseError

    header = header_of(data)
    try:
        ply = _read(path, header)
        if ply is None:
            return in_utf8(data)
        faces, corners = ply["face"].data, _corners(ply)
        xyz = np.stack([np.asarray(ply["vertex"][axis], np.float64) for axis in AXES], axis=1)
    except (PlyParseError, KeyError, StopIteration, ValueError, OverflowError, UnicodeDecodeError):
        return in_utf8(data)  # what is wrong with it is for its reader to say
    counts = np.array([len(polygon) for polygon in corners], np.int64)
    flat, starts = np.concatenate([*corners, np.zeros(0, np.int64)]).astype(np.int64), np.cumsum(counts) - counts
    if len(flat) and not 0 <= flat.min() <= flat.max() < len(xyz):
        raise InputError(path, "faces", f"name vertex {flat.max()} of {len(xyz)}")
    row, cut = _cut(xyz, flat, starts, counts)
    columns: dict[str, Array] = {name: faces[name][row] for name in faces.dtype.names if name not in (*CORNERS, PLACES)}
    columns[CORNERS[0]] = flat[starts[row, None] + cut].astype(np.int32)
    if PLACES in faces.dtype.names:
        columns[PLACES] = _places(path, faces[PLACES], counts)[starts[row, None] + cut].reshape(-1, 6)
    table = np.empty(len(row), [(name, values.dtype, values.shape[1:]) for name, values in columns.items()])
    for name, values in columns.items():
        table[name] = values
    elements = [PlyElement.describe(table, "face") if e.name == "face" else e for e in ply.elements]
    for element in elements:
        element.comments = []  # they come back with the others
    written = io.BytesIO()
    PlyData(elements, byte_order="<").write(written)
    return with_remarks(written.getbuffer(), header)


def _cut(xyz: Array, flat: Array, starts: Array, counts: Array) -> tuple[Array, Array]:
    """Which polygon each of M triangles is of, (M,), and which of its corners it has, (M, 3)."""
    rows, cuts = [np.zeros(0, np.int64)], [np.zeros((0, 3), np.int64)]
    for k in np.unique(counts[counts > 2]):
        polygons = np.flatnonzero(counts == k)
        points = xyz[flat[starts[polygons, None] + np.arange(k)]]  # (P, k, 3)
        fanned = fans_hold(points)
        fan = fan_of(int(k))
        rows.append(np.repeat(polygons[fanned], len(fan)))
        cuts.append(np.tile(fan, (int(fanned.sum()), 1)))
        for i in np.flatnonzero(~fanned):
            cuts.append(triangles_of(points[i]))
            rows.append(np.full(len(cuts[-1]), polygons[i]))
    row, cut = np.concatenate(rows), np.concatenate(cuts)
    order = np.argsort(row, kind="stable")  # as the polygons are
    return row[order], cut[order]


def _places(path: Path, stored: Array, counts: Array) -> Array:
    """Place in the texture of every corner, (sum of ``counts``, 2)."""
    if any(len(places) != 2 * count for places, count in zip(stored, counts)):
        raise InputError(path, "faces", f"expected two numbers of {PLACES} for each corner", "export triangles")
    return np.concatenate([*stored, np.zeros(0, np.float32)]).reshape(-1, 2)


def _read(path: Path, header: bytes) -> Any:
    """What plyfile makes of it, None where there is nothing but triangles, which it can tell at a glance."""
    from plyfile import PlyElementParseError

    try:
        ply = _opened(path, header, {"face": {**dict.fromkeys(CORNERS, 3), PLACES: 6}})
        if not ply.text or all(len(polygon) == 3 for polygon in _corners(ply)):
            return None
        return ply
    except PlyElementParseError:
        return _opened(path, header, {})


def _opened(path: Path, header: bytes, known: dict[str, dict[str, int]]) -> Any:
    """What plyfile makes of a file, in which lists of ``known`` lengths are mapped."""
    from plyfile import PlyData, PlyListProperty

    with AsciiHeader(path, len(header)) as stream:
        ply = PlyData.read(stream, mmap="r", known_list_len=known)
    for column in ply["face"].properties:
        if column.name in (*CORNERS, PLACES) and not isinstance(column, PlyListProperty):
            raise InputError(path, "faces", f"expected a list of {column.name} for each, got one number")
    return ply


def _corners(ply: Any) -> Array:
    """Vertices of every face, (F,) arrays of integers."""
    faces = ply["face"].data
    return np.asarray(faces[next(name for name in CORNERS if name in faces.dtype.names)])
