"""The part of OpenCV's YAML that calibrations use: numbers, names, lists of names and matrices.

Read here, because OpenCV's own reader is not meant for files from anywhere.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ...computer.array_type import Array
from ...errors import InputError
from ...storage.files import read_text

BYTE_LIMIT = 4 * 2**20
ENTRY_LIMIT = 10_000
MATRIX = "!!opencv-matrix"
Values = dict[str, "float | str | list[str] | Array"]

_ENTRY = re.compile(r"^(\w[^\s:]*):[ \t]*(.*(?:\n(?![\w%]).*)*)", re.MULTILINE)
_FIELD = re.compile(r"^[ \t]+(rows|cols|data)[ \t]*:[ \t]*(\d+|\[[^][]*\])[ \t]*$", re.MULTILINE)
_SIDE = re.compile(r"\d{1,9}")
_ITEM = re.compile(r"^[ \t]*-[ \t]*(.+)$", re.MULTILINE)


def read_opencv_yaml(path: Path) -> Values:
    """Entries of ``path`` by name: numbers, texts, lists of texts, matrices (rows, cols) float64.

    Raises:
        InputError: the file is missing or too large, or a matrix is not as large as it says or not finite.
    """
    text = read_text(path, BYTE_LIMIT)
    if not text.startswith("%YAML"):
        raise InputError(path, "header", "expected %YAML in the first line", "is it written by OpenCV?")
    entries = _ENTRY.findall(text.replace("\r\n", "\n"))
    if len(entries) > ENTRY_LIMIT:
        raise InputError(path, "", f"expected at most {ENTRY_LIMIT} entries, got {len(entries)}")
    return {key: _value(path, key, body.strip("\n")) for key, body in entries}


def _value(path: Path, key: str, body: str) -> float | str | list[str] | Array:
    if body.startswith(MATRIX):
        return _matrix(path, key, body)
    if items := _ITEM.findall(body):
        return [item.strip().strip("\"'") for item in items]
    plain = body.strip().strip("\"'")
    try:
        return float(plain)
    except ValueError:
        return plain


def _matrix(path: Path, key: str, body: str) -> Array:
    fields = dict(_FIELD.findall(body))
    if not {"rows", "cols", "data"} <= set(fields):
        raise InputError(path, key, "expected rows, cols and data")
    if not all(_SIDE.fullmatch(fields[side]) for side in ("rows", "cols")):
        got = f"{fields['rows']:.20} and {fields['cols']:.20}"
        raise InputError(path, key, f"expected whole numbers in rows and cols, got {got}")
    shape = int(fields["rows"]), int(fields["cols"])
    parts = fields["data"].strip("[]").replace(",", " ").split()
    try:
        values = np.array(parts, np.float64)
    except ValueError:
        raise InputError(path, key, "expected numbers in data") from None
    if len(values) != shape[0] * shape[1] or not np.isfinite(values).all():
        raise InputError(path, key, f"expected {shape[0]} x {shape[1]} finite numbers, got {len(values)}")
    return values.reshape(shape)
