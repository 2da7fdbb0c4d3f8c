"""What an OBJ or a PLY mesh takes while trimesh reads it, estimated from a look at its lines before that.

trimesh makes Python values of lines and of faces with many corners, so it can take a thousand times what the file does.
The figures below were measured on files of one kind each and rounded up.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

from ...computer.memory import require_free
from ...errors import InputError
from ..ply_header import HEADER_LIMIT, SIZES
from .gltf_tree import COUNT_LIMIT

OBJ_LINE, OBJ_BYTE = 150, 6  # bytes that a line takes, and a byte of it
PLY_LINE, PLY_BYTE = 250, 10
ROW = 250  # of a binary PLY
CELL = 130  # of a row of lists in a text
EDGE = 500
CORNER = 150  # of a face beyond the usual three or four
PART = 15_000  # a material of an OBJ, whose faces are a mesh of their own
LONG = 10_000  # bytes of a line

_WORD = re.compile(rb"\S+")
_FOREIGN = re.compile(rb"[^\t\r\n -~]")


@dataclass
class _Table:
    """An element of a PLY: rows, bytes of each plain column, and bytes of the count and of an entry of each list."""

    name: str
    count: int
    plain: list[int] = field(default_factory=list)
    lists: list[tuple[int, int]] = field(default_factory=list)

    @property
    def columns(self) -> int:
        return len(self.plain) + len(self.lists)

    @property
    def least(self) -> int:
        """Bytes of its binary rows, if all lists were empty."""
        return self.count * (sum(self.plain) + sum(count for count, _ in self.lists))


def check_obj(path: Path, data: bytes) -> None:
    """Hold what an OBJ takes against the memory there is.

    Raises:
        ResourceError: it is more than is free.
    """
    need = OBJ_LINE * data.count(b"\n") + OBJ_BYTE * len(data)
    _require(path, need)  # before each line is looked at
    corners, parts = 0, set()
    for line in io.BytesIO(data):
        if line[:1] in (b"v", b"#"):  # of vertices six numbers are read at most, see obj_text
            continue
        corners += max(0, _words(line) - 4)
        if line.split(None, 1)[:1] == [b"usemtl"]:
            parts.add(line.split(None, 1)[-1].strip())
    _require(path, need + CORNER * corners + PART * len(parts))


def check_ply(path: Path, data: bytes) -> None:
    """Hold what a PLY's header promises against the file, and what that takes against the memory there is.

    Raises:
        InputError: the header is damaged or asks for more than the file holds, or rows of text are uneven or
            too many.
        ResourceError: it takes more than is free.
    """
    header = list(_header(path, data))
    start = sum(len(line) for line in header)
    tables = _tables(path, header, len(data))
    text = len(header) > 1 and b"ascii" in header[1].lower()
    need = _of_text(path, data, start, tables) if text else _of_binary(data, start, tables)
    _require(path, need + EDGE * sum(table.count for table in tables if table.name == "edge"))


def _words(line: bytes) -> int:
    """How many a line has; those of a long one are not made, which would take more than the estimate."""
    return len(line.split()) if len(line) <= LONG else sum(1 for _ in _WORD.finditer(line))


def _require(path: Path, need: int) -> None:
    require_free(need, path, "its vertices and faces", "thin the file")


def _header(path: Path, data: bytes) -> Iterator[bytes]:
    """Lines of the header, the last one with the word end_header."""
    if data.startswith(b"ply"):
        for line in io.BytesIO(data[:HEADER_LIMIT]):
            yield line
            if b"end_header" in line.split():
                return
    raise InputError(path, "header", "expected a PLY header", "is it cut off?")


def _tables(path: Path, header: Sequence[bytes], size: int) -> list[_Table]:
    tables: dict[str, _Table] = {}
    current = None
    for line in header:
        words = line.decode("ascii", "replace").split()
        if "element" in "".join(words[:1]):  # as trimesh looks for it
            counted = len(words) == 3 and words[2].isdecimal() and len(words[2]) <= 18  # digits, which int() limits too
            if not counted or int(words[2]) > min(COUNT_LIMIT, size):
                raise InputError(path, "header", f"{' '.join(words)[:60]!r} asks for more than the file holds")
            current = tables[words[1]] = _Table(words[1], int(words[2]))
        elif "property" in "".join(words[:1]) and current is not None:
            sizes = [SIZES.get(word, 1) for word in words[1:-1]]
            if len(sizes) == 1:
                current.plain.append(sizes[0])
            else:
                current.lists.append((sizes[-2], sizes[-1]) if len(sizes) > 1 else (1, 1))
    if sum(table.count * table.columns for table in tables.values()) > size:
        raise InputError(path, "header", "its rows ask for more than the file holds")
    return list(tables.values())


def _of_text(path: Path, data: bytes, start: int, tables: Sequence[_Table]) -> int:
    """Bytes at the peak; the rows of a table without lists must be of one width."""
    if found := _FOREIGN.search(data, start):
        raise InputError(path, "body", f"expected ASCII text, got byte {data[found.start()]} at {found.start()}")
    stream = io.BytesIO(data)
    stream.seek(start)
    need = PLY_LINE * (data.count(b"\n") + data.count(b"\r")) + PLY_BYTE * len(data)
    _require(path, need)  # before each line is looked at
    for table in tables:
        widths = (_words(line) for line in islice(stream, table.count))
        if table.lists:
            need += CELL * table.count * table.columns + CORNER * max(0, sum(widths) - 5 * table.count)
            continue
        width = next(widths, 0)
        for row, other in enumerate(widths, start=1):
            if other != width:
                where = f"element {table.name[:40]}"
                raise InputError(path, where, f"expected {width} numbers in each row, got {other} in row {row}")
    if any(line.strip() for line in stream):
        raise InputError(path, "body", "lines follow the last element")
    return need


def _of_binary(data: bytes, start: int, tables: Sequence[_Table]) -> int:
    rows = sum(table.count for table in tables)
    smallest = min((entry for table in tables for _, entry in table.lists), default=1)
    usual = 8 * sum(table.count for table in tables if table.lists)
    corners = (len(data) - start - sum(table.least for table in tables)) // smallest - usual
    return ROW * rows + 2 * len(data) + CORNER * max(0, corners)
