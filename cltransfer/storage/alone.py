"""A folder that one process at a time works in."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path

from ..errors import ResourceError


@contextmanager
def alone(folder: Path, what: str, option: str = "--out") -> Iterator[None]:
    """Keep other processes out of ``folder``, which is made, while the block works; where the system has no locks, no.

    A folder that was made and that the block leaves empty is taken away again.

    Args:
        folder: what is locked is the folder itself: no file is left in it, and none that is closed drops the lock.
        what: is being done in it.
        option: that names the folder.

    Raises:
        ResourceError: another process is in such a block.
    """
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    with _locked(folder, what, option):
        try:
            yield
        finally:
            with suppress(OSError):  # it holds something, and so do those around it
                for path in made:
                    path.rmdir()


@contextmanager
def _locked(folder: Path, what: str, option: str) -> Iterator[None]:
    if find_spec("fcntl") is None:
        yield
        return
    import fcntl

    handle = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):  # a network drive without locks
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                hint = f"wait until it ends, or name another {option}"
                raise ResourceError(folder, option, f"another process {what} there", hint) from None
        yield
    finally:
        os.close(handle)
