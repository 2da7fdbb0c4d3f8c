"""What lies in the cache, by kind: all of it can be made, got or named again."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ..errors import UsageError
from .files import cache_dir, refuse_link

MADE = {  # kinds that a run makes again by itself
    "features": "clips as they were read",
    "lifts": "persons that were found in scenes",
    "floaters": "what hangs in the air in scenes",
}
NOTED = {"scenes": "where scenes were seen last, by which runs are rendered again"}  # which no verb finds out again
PULLED = {"models": "networks that were pulled or adopted", "assets": "demo scenes and clips that were pulled"}
KINDS = {**MADE, **NOTED, **PULLED}


@dataclass(frozen=True)
class Held:
    """What the cache holds of one kind.

    Args:
        kind: name of its folder.
        what: in words.
        files: how many.
        size: [bytes].
    """

    kind: str
    what: str
    files: int
    size: int


def held() -> list[Held]:
    """What the cache holds, a row a kind."""
    rows = []
    for kind, what in KINDS.items():
        sizes = [file.lstat().st_size for file in _files(cache_dir() / kind)]
        rows.append(Held(kind, what, len(sizes), sum(sizes)))
    return rows


def clear(kinds: Sequence[str] = ()) -> list[Held]:
    """Delete all of ``kinds``, of :data:`MADE` where none is named; returns what was there.

    Raises:
        UsageError: there is no such kind.
        InputError: the folder of one is a link.
    """
    for kind in kinds:
        if kind not in KINDS:
            raise UsageError("", kind, "expected a kind of what the cache holds", ", ".join(KINDS))
    gone = [row for row in held() if row.kind in (kinds or MADE)]
    for row in gone:
        folder = cache_dir() / row.kind
        refuse_link(folder)
        if folder.is_dir():
            shutil.rmtree(folder)  # follows no link in it
    return gone


def _files(folder: Path) -> list[Path]:
    return [] if folder.is_symlink() else [file for file in folder.rglob("*") if file.is_symlink() or file.is_file()]
