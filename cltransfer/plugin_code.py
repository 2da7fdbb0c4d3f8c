"""What a plugin's code is known again by, so that nothing is kept of other code than gave it.

A result is cached, a run taken up and a trial left out where what it depends on is the same; a plugin's code is part of
that. What comes with cltransfer is known by its version instead. No torch, and nothing is imported here.
"""

from __future__ import annotations

import hashlib
import sys
from itertools import takewhile
from pathlib import Path
from typing import Any

_IMPORTED: dict[Path, str] = {}  # digest of what was imported last, by its file or package


def code_of(component: object) -> str:
    """SHA-256 of a plugin's code as it was imported: the file of its class, or all Python files of its package.

    ``component`` is one, or its class. Empty for what comes with cltransfer. Hidden files and folders are none of it.
    """
    cls = component if isinstance(component, type) else type(component)
    if _ours(cls):
        return ""
    place = _home(cls)
    if place in _IMPORTED:
        return _IMPORTED[place]
    return _code_at(place) if place is not None and place.exists() else ""


def remember(cls: type[Any]) -> None:
    """Keep what the code of ``cls`` is now, as it is imported: this process goes on with that when it is edited."""
    place = None if _ours(cls) else _home(cls)
    if place is not None and place.exists():
        _IMPORTED[place] = _code_at(place)


def code_in(package: Path) -> str:
    """SHA-256 of the names and contents of every Python file in a folder that is not hidden."""
    digest = hashlib.sha256()
    for part in sorted(package.rglob("*.py")):
        if not part.is_file() or any(name.startswith(".") for name in part.relative_to(package).parts):
            continue
        digest.update(f"{part.relative_to(package)}\0{hashlib.sha256(part.read_bytes()).hexdigest()}\0".encode())
    return digest.hexdigest()


def _ours(cls: type[Any]) -> bool:
    return cls.__module__.partition(".")[0] == "cltransfer"


def _home(cls: type[Any]) -> Path | None:
    """The file of a class, or the package that it lies in; None where it has none."""
    file = getattr(sys.modules.get(cls.__module__), "__file__", None)
    return None if file is None else _package(Path(file)) or Path(file)


def _code_at(place: Path) -> str:
    return code_in(place) if place.is_dir() else hashlib.sha256(place.read_bytes()).hexdigest()


def _package(file: Path) -> Path | None:
    """The outermost folder of the package that ``file`` lies in, None where it is part of none."""
    folders = list(takewhile(lambda folder: (folder / "__init__.py").is_file(), file.parents))
    return folders[-1] if folders else None
