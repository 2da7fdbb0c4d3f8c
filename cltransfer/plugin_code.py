"""What a plugin's code is known again by, so that nothing is kept of other code than gave it.

A result is cached, a run taken up and a trial left out where what it depends on is the same; a plugin's code is part of
that. What comes with cltransfer is known by its version instead. No torch, and nothing is imported here.
"""

from __future__ import annotations

import hashlib
import sys
from itertools import takewhile
from pathlib import Path


def code_of(component: object) -> str:
    """SHA-256 of a plugin's code: the file of its class, or every Python file of the package that this lies in.

    ``component`` is one, or its class. Empty for what comes with cltransfer. Hidden files and folders are none of it.
    """
    module = (component if isinstance(component, type) else type(component)).__module__
    file = getattr(sys.modules.get(module), "__file__", None)
    if module.partition(".")[0] == "cltransfer" or file is None:
        return ""
    package = _package(Path(file))
    return hashlib.sha256(Path(file).read_bytes()).hexdigest() if package is None else code_in(package)


def code_in(package: Path) -> str:
    """SHA-256 of the names and contents of every Python file in a folder that is not hidden."""
    digest = hashlib.sha256()
    for part in sorted(package.rglob("*.py")):
        if not part.is_file() or any(name.startswith(".") for name in part.relative_to(package).parts):
            continue
        digest.update(f"{part.relative_to(package)}\0{hashlib.sha256(part.read_bytes()).hexdigest()}\0".encode())
    return digest.hexdigest()


def _package(file: Path) -> Path | None:
    """The outermost folder of the package that ``file`` lies in, None where it is part of none."""
    folders = list(takewhile(lambda folder: (folder / "__init__.py").is_file(), file.parents))
    return folders[-1] if folders else None
