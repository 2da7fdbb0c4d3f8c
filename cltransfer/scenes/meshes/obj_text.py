"""An OBJ as trimesh reads it right.

It takes one library, counts back from the end of the file, closes inlets, knows one kind of corner a material, looks
for materials in remarks and names too, and passes over keys that stand after or before a tab.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...computer.array_type import Array
from ...errors import InputError
from .mtl import BOM, WITHOUT, ObjFiles
from .polygons import fans_hold, triangles_of

_INDENT = re.compile(rb"^ +", re.MULTILINE)
_UNREAD = re.compile(rb"^(?!(?:v|vt|vn|f|usemtl|mtllib) )[^\n]*\n?", re.MULTILINE)  # groups, remarks, empty lines
_LIBRARY = re.compile(rb"^mtllib[ \t]+(.*)$", re.MULTILINE)
_LONG = re.compile(rb"^f(?:[ \t]+[^ \t\n]+){4}", re.MULTILINE)
_BACK = re.compile(rb"^f[ \t][^\n#]*-\d", re.MULTILINE)
_REMARK = re.compile(rb"^((?:v|vt|vn|f)[ \t][^\n#]*)#[^\n]*", re.MULTILINE)
_REST = re.compile(rb"/\S*|#.*")  # of a corner behind the number of its vertex; of a line, a remark
_VERTEX, _PLACE = (re.compile(rb"^%s[ \t]" % key, re.MULTILINE) for key in (b"v", b"vt"))
_FIRST, _SECOND = re.compile(rb"(?<!\S)[^\s/]+"), re.compile(rb"(?<!\S)[^\s/]+/([^\s/]+)")  # number of a corner
_TOGETHER = 50_000  # faces looked at
_FROM_ONE = "expected a number of the {} {}, which count from 1, got {}"
_WIDE = re.compile(rb"^v[tn]?(?:[^\S\n]++\S++){4}", re.MULTILINE)
_COLUMNS = {b"v": (6, 3), b"vt": (2, 1), b"vn": (3,)}  # numbers that trimesh takes of all lines, if all have as many
_FACE = re.compile(rb"^f[ \t]+([^\n#]*)", re.MULTILINE)
_NUMBERED = (b"v", b"vt", b"vn")  # what the numbers of a corner are of, in this order
_PLACED = re.compile(rb"^f[ \t]+-?\d+/-?\d", re.MULTILINE)
_BARE = re.compile(rb"^f[ \t]+-?\d+(?://|[ \t])", re.MULTILINE)


def readable(path: Path, data: bytes, files: ObjFiles) -> bytes:
    """The lines that are read, with one library, absolute numbers, inlets left open, and materials of one kind of face.

    Faces without places in a texture that share a material with others get one of its name and
    :data:`.mtl.WITHOUT`, else the others would lose theirs.

    Args:
        path: for error lines.
        data: of the file.
        files: gives the libraries; what they are is told to it.

    Raises:
        InputError: a vertex or a face is no numbers, or a face names a vertex that is not there, or a place in a
            texture where the file has any.
    """
    text = data.removeprefix(BOM).replace(b"\r\n", b"\n").replace(b"\\\n", b" ").replace(b"\t", b" ")
    text = _UNREAD.sub(b"", _INDENT.sub(b"", text))
    if b"#" in text:
        text = _REMARK.sub(rb"\1", text)
    if _WIDE.search(text):
        text = _narrow(text)
    if _BACK.search(text):
        text = b"\n".join(_counted(text.split(b"\n")))
    _check_faces(path, text)
    _check_places(path, text)
    names = [name for line in _LIBRARY.findall(text) for name in files.named(line.strip().decode("utf-8", "replace"))]
    bare = bool(names and _PLACED.search(text) and _BARE.search(text))
    if len(names) < 2 and not bare and not _LONG.search(text):
        return text
    lines = text.split(b"\n")
    if _LONG.search(text):
        lines = _cut(path, lines)
    renamed = _rename(lines) if bare else frozenset()
    if len(names) > 1 or renamed:
        joined = files.join(names, renamed).encode()
        lines = [line for line in lines if not _LIBRARY.match(line)]
        lines.insert(0, b"mtllib " + joined)
    return b"\n".join(lines)


def _narrow(text: bytes) -> bytes:
    """The text with no more numbers in a line than are read: of uneven lines each number becomes a Python value."""
    for key, widths in _COLUMNS.items():
        short = (rb"^%s(?:[^\S\n]++\S++){0,%d}[^\S\n]*$" % (key, width - 1) for width in widths[:-1])
        even = (width for width, line in zip(widths, short) if not re.search(line, text, re.MULTILINE))
        read = rb"^(%s(?:[^\S\n]++\S++){%d})[^\n]+" % (key, next(even, widths[-1]))
        text = re.sub(read, rb"\1", text, flags=re.MULTILINE)
    return text


def _counted(lines: Sequence[bytes]) -> list[bytes]:
    """The lines with numbers that count back from where they stand as those that count from the first."""
    before, counted = [0, 0, 0], list(lines)
    for i, line in enumerate(lines):
        key = line[:2].rstrip()
        if key in _NUMBERED:
            before[_NUMBERED.index(key)] += 1
        elif key == b"f" and b"-" in line:
            counted[i] = b"f " + b" ".join(_corner(word, before) for word in _words(line))
    return counted


def _check_faces(path: Path, text: bytes) -> None:
    """Refuse a face that names no vertex of the file, in which all numbers count from the first."""
    _check_numbers(path, text, _FIRST, len(_VERTEX.findall(text)), "vertices")


def _check_places(path: Path, text: bytes) -> None:
    """Refuse a face that names no place of a file that has places in a texture, and a library that may show one."""
    count = len(_PLACE.findall(text))
    if count and _LIBRARY.search(text):
        _check_numbers(path, text, _SECOND, count, "places in a texture (vt)")


def _check_numbers(path: Path, text: bytes, told: re.Pattern[bytes], count: int, what: str) -> None:
    """Refuse a face of which one of the numbers that are ``told`` is of none of ``count``."""
    faces = _FACE.findall(text)
    for before in range(0, len(faces), _TOGETHER):
        some = faces[before : before + _TOGETHER]
        if _from_one(told.findall(b" ".join(some)), count):
            continue
        for number, face in enumerate(some, start=before + 1):
            for word in told.findall(face):
                if not _from_one([word], count):
                    came = word.decode("utf-8", "replace")
                    raise InputError(path, f"face {number}", _FROM_ONE.format(count, what, came))


def _from_one(words: Sequence[bytes], count: int) -> bool:
    """Whether all ``words`` are whole numbers from 1 to ``count``."""
    try:
        numbers = np.array(words, np.float64)
    except ValueError:
        return False
    return bool(((numbers >= 1) & (numbers <= count) & (numbers == numbers.round())).all())


def _corner(word: bytes, before: Sequence[int]) -> bytes:
    return b"/".join(
        b"%d" % (count + 1 + int(number)) if _counts_back(number, count) else number
        for number, count in zip(word.split(b"/"), before)
    )


def _counts_back(number: bytes, count: int) -> bool:
    """Whether it counts back from where it stands, and not farther than the first of ``count``."""
    return re.fullmatch(rb"-\d{1,18}", number) is not None and -int(number) <= count


def _cut(path: Path, lines: Sequence[bytes]) -> list[bytes]:
    """The lines with those of polygons that are no fan replaced by their triangles."""
    xyz = _numbers(path, "vertices", [line[1:] for line in lines if line.startswith((b"v ", b"v\t"))])[:, :3]
    long: dict[int, list[int]] = {}  # lines, by corners
    for i, line in enumerate(lines):
        if line.startswith((b"f ", b"f\t")) and (count := len(_words(line))) > 3:
            long.setdefault(count, []).append(i)
    cut = list(lines)
    for places in long.values():
        index = _numbers(path, "faces", [_REST.sub(b"", lines[i][1:]) for i in places]).astype(np.int64) - 1  # (F, k)
        points = xyz[index]  # (F, k, 3)
        for f in np.flatnonzero(~fans_hold(points)):
            corners = _words(lines[places[f]])
            triangles = (b"f " + b" ".join(corners[c] for c in three) for three in triangles_of(points[f]))
            cut[places[f]] = b"\n".join(triangles)
    return b"\n".join(cut).split(b"\n")


def _words(line: bytes) -> list[bytes]:
    """What follows the first word, without a remark."""
    return line.partition(b"#")[0].split()[1:]


def _numbers(path: Path, what: str, rows: Sequence[bytes]) -> Array:
    """The numbers of rows, (R, C) float64, as many of each as of the shortest.

    Raises:
        InputError: there are not three of each, or something else.
    """
    try:
        flat = np.array(b" ".join(rows).split(), np.float64)
        if rows and len(flat) == len(rows) * len(rows[0].split()) >= 3 * len(rows):
            return flat.reshape(len(rows), -1)
        words = [row.split() for row in rows]
        least = min((len(row) for row in words), default=3)
        if least >= 3:
            return np.array([row[:least] for row in words], np.float64).reshape(-1, least)
    except ValueError:
        pass
    raise InputError(path, what, "expected three numbers or more of each")


def _rename(lines: list[bytes]) -> frozenset[str]:
    """Give faces without places in a texture another material, in ``lines``; the names of those that share theirs."""
    kinds: dict[bytes, set[bool]] = {}
    faces: list[tuple[int, bytes, bool, bool]] = []  # line, material, whether it has places, and those before it had
    material, shown = b"", True
    for i, line in enumerate(lines):
        if line.startswith((b"usemtl ", b"usemtl\t")):
            material, shown = line[6:].strip(), True
        elif line.startswith((b"f ", b"f\t")):
            placed = bool(_PLACED.match(line))
            kinds.setdefault(material, set()).add(placed)
            faces.append((i, material, placed, shown))
            shown = placed
    both = {name for name, found in kinds.items() if len(found) == 2 and name}
    for i, name, placed, shown in faces:
        if name in both and placed != shown:  # a line for each run of them
            lines[i] = b"usemtl %s%s\n%s" % (name, b"" if placed else WITHOUT.encode(), lines[i])
    return frozenset(name.decode("utf-8", "replace") for name in both)
