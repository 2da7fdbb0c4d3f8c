"""What writers of whole files have left under their temporary names where they were killed."""

from __future__ import annotations

import re
from pathlib import Path

_TEMPORARY = re.compile(r"\.(?:tmp|new)-\d+-[0-9a-f]{8}-(.+)", re.DOTALL)  # as storage.files.atomic names them


def left_in(folder: Path, names: re.Pattern[str]) -> list[Path]:
    """What killed writers of files in ``folder`` have left that are called as ``names`` say."""
    found = ((path, _TEMPORARY.fullmatch(path.name)) for path in sorted(folder.glob(".*-*")))
    return [path for path, named in found if named is not None and names.fullmatch(named[1])]


def holds_others(folder: Path, names: re.Pattern[str]) -> bool:
    """Whether anything lies in ``folder`` besides what :func:`left_in` finds."""
    return folder.is_dir() and not set(folder.iterdir()) <= set(left_in(folder, names))


def clear_left(folder: Path, names: re.Pattern[str]) -> None:
    """Take away what :func:`left_in` finds; whoever calls holds the folder, lest a writer is at work."""
    for path in left_in(folder, names):
        path.unlink(missing_ok=True)
