"""The ledger of a sweep: one line of JSON a trial, appended and synced, so that a sweep that was killed goes on."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from ..computer.memory import require_parsed
from ..storage.kept_lines import keep, read_kept
from .outcome import Outcome

LIMIT = 2**28  # bytes; a trial takes about 1 kB


def read_ledger(path: Path) -> dict[str, Outcome]:
    """Outcomes by key; a last line that was cut off by a kill is left out, and cut off the file.

    Raises:
        InputError: another line is damaged, or the file is too large or a link.
        ResourceError: there may not be memory for them.
    """
    return {outcome.key: outcome for outcome in read_kept(path, LIMIT, Outcome.from_json, "trial", require_parsed)}


def append(path: Path, outcome: Outcome) -> None:
    """Add ``outcome``; it is on the disk when this returns."""
    keep(path, asdict(outcome))
