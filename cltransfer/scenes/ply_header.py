"""PLY headers, read with limits before anything is allocated: a scene file may come from anywhere."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..storage.files import check_size

HEADER_LIMIT = 64 * 1024  # bytes
PROPERTY_LIMIT = 256
COUNT_LIMIT = 20_000_000  # rows of one element
BLOCK = 2**16  # rows read at a time
FORMAT = "binary_little_endian 1.0"
SIZES = {  # bytes
    **{"char": 1, "uchar": 1, "short": 2, "ushort": 2, "int": 4, "uint": 4, "float": 4, "double": 8},
    **{"int8": 1, "uint8": 1, "int16": 2, "uint16": 2, "int32": 4, "uint32": 4, "float32": 4, "float64": 8},
}
Table = np.ndarray[Any, np.dtype[Any]]
REMARKS = ([b"comment"], [b"obj_info"])  # words that begin a line that may hold anything
VERTICAL = "Vertical Axis:"  # remark by which nerfstudio tells which way is up
OF_SPLATS = frozenset({"f_dc_0", "opacity", "scale_0", "rot_0", "packed_position"})  # properties that no others have
_HINT = "is it a Gaussian-splat PLY?"


@dataclass(frozen=True)
class Element:
    """One table of a PLY: its number of rows and the type of each column."""

    count: int
    types: dict[str, str] = field(default_factory=dict)

    @property
    def dtype(self) -> np.dtype[np.void]:
        """Of a row."""
        kinds = {"u": "u", "f": "f", "d": "f"}  # by first letter; all else is a signed integer
        return np.dtype([(name, f"<{kinds.get(kind[0], 'i')}{SIZES[kind]}") for name, kind in self.types.items()])

    @property
    def size(self) -> int:
        """Bytes of the whole table."""
        return self.count * sum(SIZES[kind] for kind in self.types.values())


def check_header(path: Path, splats: bool = False) -> dict[str, Element]:
    """Elements of a binary little-endian PLY of fixed-width rows whose size is exactly what its header says.

    Args:
        path: of the file.
        splats: whether points that are no Gaussians are refused, however they are written.

    Raises:
        InputError: the file is missing or empty; the header is foreign, cut off, too long or asks for more than the
            limits; rows are cut off or bytes follow them.
    """
    check_size(path, sys.maxsize)  # what it may have is told in rows
    with path.open("rb") as stream:
        start = stream.read(HEADER_LIMIT)
    if not start:
        raise InputError(path, "header", "file is empty")
    if not start.startswith((b"ply\n", b"ply\r")):
        raise InputError(path, "magic", "expected 'ply' in the first line", _HINT)
    header, mark, _ = start.partition(b"\nend_header\n")
    if not mark:
        long = len(start) == HEADER_LIMIT
        reason = f"longer than {HEADER_LIMIT} bytes" if long else "cut off before 'end_header'"
        crlf = b"\nend_header\r" in start
        raise InputError(path, "header", "expected lines that end in LF, got CR" if crlf else reason)
    lines = [line for line in header.splitlines()[1:] if line.split()[:1] not in REMARKS]
    try:
        elements, written = _parse(path, [line.decode("ascii") for line in lines])
    except UnicodeDecodeError:
        raise InputError(path, "header", "expected ASCII text") from None
    if splats:
        _refuse_points(path, elements)
    if written != FORMAT:
        reason = f"expected {FORMAT}, got {written[:60]!r}"
        raise InputError(path, "format", reason, "save it as binary little endian")
    _check_whole(path, len(header) + len(mark), elements)
    return elements


def read_rows(path: Path, elements: Mapping[str, Element], name: str, first: int = 0, count: int = -1) -> Table:
    """Rows of element ``name`` from ``first``, at most ``count``, of a file that :func:`check_header` found whole."""
    size = sum(element.size for element in elements.values())
    before = sum(element.size for element in list(elements.values())[: list(elements).index(name)])
    element = elements[name]
    left = element.count - first
    offset = path.stat().st_size - size + before + first * element.dtype.itemsize
    return np.fromfile(path, element.dtype, left if count < 0 else min(count, left), offset=offset)


def read_columns(path: Path, elements: Mapping[str, Element], name: str, columns: Sequence[str]) -> Table:
    """Some columns of element ``name``, read block by block: the others may be many."""
    element = elements[name]
    table = np.empty(element.count, [(column, element.dtype[column]) for column in columns])
    for first in range(0, element.count, BLOCK):
        rows = read_rows(path, elements, name, first, BLOCK)
        for column in columns:
            table[column][first : first + BLOCK] = rows[column]
    return table


def header_of(data: bytes) -> bytes:
    """Bytes of a file before the word that ends its header."""
    return data[:HEADER_LIMIT].partition(b"end_header")[0]


def is_z_up(path: Path) -> bool:
    """Whether the header of a PLY calls z its vertical axis."""
    with path.open("rb") as stream:
        header = header_of(stream.read(HEADER_LIMIT))
    return f"comment {VERTICAL} z".lower().encode() in (b" ".join(line.lower().split()) for line in header.splitlines())


def has_faces(path: Path) -> bool:
    """Whether a PLY says it holds a mesh; False too where it is no PLY or not there, which its reader reports."""
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        header = header_of(stream.read(HEADER_LIMIT))
    lines = [line.split() for line in header.splitlines()]
    return any(line[:2] == [b"element", b"face"] and line[2:] != [b"0"] for line in lines)


def _refuse_points(path: Path, elements: Mapping[str, Element]) -> None:
    vertex = elements.get("vertex")
    if vertex is not None and {"x", "y", "z"} <= vertex.types.keys() and OF_SPLATS.isdisjoint(vertex.types):
        reason = "expected splats or a mesh, got a point cloud, which is neither"
        raise InputError(path, "element vertex", reason, "`cltransfer fit` makes a scene of posed photographs")


def _parse(path: Path, lines: Iterable[str]) -> tuple[dict[str, Element], str]:
    """Elements by name, and how they are written, from the lines after the magic."""
    elements: dict[str, Element] = {}
    current, written = "", ""
    for line in lines:
        match line.split():
            case []:
                continue
            case ["format", *rest]:
                written = " ".join(rest)
            case ["element", name, count]:
                if name in elements:
                    raise InputError(path, f"element {name[:40]}", "is there twice")
                current = name
                elements[name] = Element(_count(path, name, count))
            case ["property", *rest] if not current:
                raise InputError(path, f"property {' '.join(rest)[:60]}", "stands before any element")
            case ["property", "list", *_] if elements[current].count == 0:
                continue  # faces of a cloud: no rows, no bytes
            case ["property", "list", *_]:
                raise InputError(path, f"element {current[:40]}", "holds lists, expected numbers only", _HINT)
            case ["property", kind, name]:
                _add(path, elements[current], name, kind)
            case _:
                raise InputError(path, "header", f"unknown line {line[:60]!r}")
    if not written:
        raise InputError(path, "format", "is missing from the header")
    return elements, written


def _count(path: Path, name: str, text: str) -> int:
    """Number of rows, checked."""
    where = f"element {name[:40]}"
    if not text.isdecimal() or len(text) > 18:
        raise InputError(path, where, f"expected a number of rows, got {text[:40]!r}")
    if int(text) > COUNT_LIMIT:
        raise InputError(path, where, f"expected at most {COUNT_LIMIT} rows, got {text}")
    return int(text)


def _add(path: Path, element: Element, name: str, kind: str) -> None:
    """Add one column, checked."""
    where = f"property {name[:40]}"
    if kind not in SIZES:
        raise InputError(path, where, f"unknown type {kind[:40]!r}")
    if name in element.types:
        raise InputError(path, where, "is there twice")
    if len(element.types) >= PROPERTY_LIMIT:
        raise InputError(path, where, f"expected at most {PROPERTY_LIMIT} properties")
    element.types[name] = kind


def _check_whole(path: Path, header: int, elements: dict[str, Element]) -> None:
    """Compare the bytes the header asks for with those that are there."""
    expected = header + sum(element.size for element in elements.values())
    actual = path.stat().st_size
    if actual < expected:
        raise InputError(path, "body", f"cut off: expected {expected} bytes, got {actual}")
    if actual > expected:
        raise InputError(path, "body", f"{actual - expected} bytes follow the last element")
