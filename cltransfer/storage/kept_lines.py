"""Values on disk, a line of JSON each, safe before the next is made: what was killed in the middle can go on."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from ..errors import InputError
from .files import check_size, refuse_link, written

LONGEST = 2**22  # bytes; a row of 2,000 frames takes about 700 kB
STRIDE = 2**20  # bytes that are read before it is asked again what is free, which takes 0.1 ms
Value = TypeVar("Value")


def read_kept(
    path: Path, limit: int, parse: Callable[[Any], Value], kind: str, afford: Callable[[int, Path], None]
) -> list[Value]:
    """Values of a file's lines, none where there is no file; a last line that a kill has torn is cut off it.

    A line at a time: what somebody's file nests in one line may take thirty times the memory of its text.

    Args:
        path: of the file.
        limit: bytes that it may have.
        parse: a value of the JSON in one line; what it raises of ValueError, TypeError, KeyError or AttributeError
            means that the line holds none.
        kind: what a line is, for errors.
        afford: raises where there is no memory left for the values of so many bytes of that file, which are read next.

    Raises:
        InputError: another line is damaged or longer than :data:`LONGEST`, or the file is a link, a folder or too
            large.
    """
    refuse_link(path)
    if not path.exists():
        return []
    check_size(path, limit)
    size = path.stat().st_size
    found, end, afforded = list[Value](), 0, 0
    with path.open("rb") as stream:
        for number, line in enumerate(iter(lambda: stream.readline(LONGEST + 1), b""), 1):
            if len(line) > LONGEST:
                raise InputError(path, f"line {number}", f"expected at most {LONGEST} bytes")
            if not line.endswith(b"\n"):
                os.truncate(path, end)
                break
            if end + len(line) > afforded:
                ahead = max(len(line), min(STRIDE, size - end))
                afford(ahead, path)
                afforded = end + ahead
            end += len(line)
            try:
                found.append(parse(json.loads(line)))
            except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
                hint = "remove the line to run that trial again"
                raise InputError(path, f"line {number}", f"is no {kind}", hint) from None
    return found


def keep(path: Path, value: Any) -> None:
    """Add a line for ``value``, plain JSON without NaN; it is on the disk when this returns."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with written(path), path.open("ab") as stream:
        stream.write(json.dumps(value, allow_nan=False).encode() + b"\n")
        stream.flush()
        os.fsync(stream.fileno())
