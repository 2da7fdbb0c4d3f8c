"""What a scene file may open: files beside or below it, of a bounded size, and nothing else."""

from __future__ import annotations

import os
import re
from pathlib import Path
from urllib.parse import unquote

from ...computer.memory import require_free
from ...errors import CltransferError, InputError, ResourceError
from ...storage.files import check_size

LIMIT = 2**30  # bytes of one file

_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:")


def inside(root: Path, name: str, where: Path, field: str) -> Path:
    """The file ``name`` under the folder ``root``, which the file ``where`` asks for in ``field``.

    Raises:
        InputError: the name leads out of the folder (by ``..``, a link, or as an absolute path or an address), or
            there is no such file.
    """
    try:
        os.fsencode(name)
    except UnicodeEncodeError:  # half of a character
        raise InputError(where, field, f"no such file {name[:80]!r}") from None
    parts = name.replace("\\", "/").split("/")
    if _SCHEME.match(name) or name.startswith(("/", "\\")) or ".." in parts or "\0" in name:
        raise InputError(where, field, f"names {name[:80]!r}", "expected a file in this folder or below")
    path = root / name if os.path.isfile(root / name) else root.joinpath(*parts)  # with \ it was written on Windows
    if not Path(os.path.realpath(path)).is_relative_to(os.path.realpath(root)):
        raise InputError(where, field, f"{name[:80]!r} is a link out of the folder")
    if not os.path.isfile(path):  # which a name that is too long is not either
        raise InputError(where, field, f"no such file {name[:80]!r}")
    return path


def read_limited(path: Path, limit: int = LIMIT) -> bytes:
    """Bytes of ``path``.

    Raises:
        InputError: it is no file, empty, or larger than ``limit`` bytes.
        ResourceError: it is larger than what is free.
    """
    check_size(path, limit)
    size = path.stat().st_size
    if size == 0:
        raise InputError(path, "", "file is empty")
    require_free(size, path, "its bytes", "make the file smaller")
    return path.read_bytes()


class Beside:
    """Gives a mesh reader the files that ``path`` names, and remembers what it gave and what it refused.

    It has the methods of a trimesh resolver; trimesh goes on without what it was refused, our readers do not.

    Args:
        path: of the mesh.
        first: bytes of the first file that is asked for, at most.
    """

    def __init__(self, path: Path, first: int = LIMIT) -> None:
        self.path, self._first = path, first
        self.given: list[Path] = []
        self.refused: CltransferError | None = None
        self._read: dict[Path, bytes] = {}

    def place(self, name: str) -> Path:
        """The file ``name`` beside or below; see :func:`inside` for what is refused."""
        return inside(self.path.parent, unquote(str(name)), self.path, "uri")

    def find(self, name: str) -> Path:
        """As :meth:`place`; the file counts as given."""
        try:
            found = self.place(name)
        except InputError as error:
            self.refused = self.refused or error
            raise
        if found not in self.given:
            self.given.append(found)
        return found

    def get(self, name: str) -> bytes:
        """Bytes of the file ``name``, which is read once however often it is asked for."""
        found = self.find(name)
        key = found.resolve()
        limit = self._first if found == self.given[0] else LIMIT
        try:
            self._read[key] = self._read.get(key) or read_limited(found, limit)
        except (InputError, ResourceError) as error:
            self.refused = self.refused or error
            raise
        return self._read[key]

    __getitem__ = get

    def keys(self) -> list[str]:
        """Nothing: what is not asked for by name is not looked for."""
        return []
