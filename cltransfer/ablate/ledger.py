"""The ledger of a sweep: one line of JSON a trial, appended and synced, so that a sweep that was killed goes on."""

from __future__ import annotations

import json
import os
from dataclasses import asdict
from pathlib import Path

from ..errors import InputError
from ..files import refuse_link
from .trial import Outcome

LIMIT = 2**28  # bytes; a trial takes about 1 kB


def read_ledger(path: Path) -> dict[str, Outcome]:
    """Outcomes by key; a last line that was cut off by a kill is left out, and cut off the file.

    Raises:
        InputError: another line is damaged, or the file is too large or a link.
    """
    refuse_link(path)
    if not path.exists():
        return {}
    if path.stat().st_size > LIMIT:
        raise InputError(path, "", f"expected at most {LIMIT} bytes, got {path.stat().st_size}")
    data = path.read_bytes()
    whole = data[: data.rfind(b"\n") + 1]
    if len(whole) < len(data):
        os.truncate(path, len(whole))
    found = {}
    for number, line in enumerate(whole.splitlines(), 1):
        try:
            outcome = Outcome.from_json(json.loads(line))
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            raise InputError(path, f"line {number}", "is no trial", "remove the line to run that trial again") from None
        found[outcome.key] = outcome
    return found


def append(path: Path, outcome: Outcome) -> None:
    """Add ``outcome``; it is on the disk when this returns."""
    with path.open("ab") as stream:
        stream.write(json.dumps(asdict(outcome), allow_nan=False).encode() + b"\n")
        stream.flush()
        os.fsync(stream.fileno())
