"""What one process at a time works in: a folder, where a second is refused, or a file, where it waits."""

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
    hint = "wait until it ends" + f", or name another {option}" * (option != "--resume")
    with _locked(folder, os.O_RDONLY, ResourceError(folder, option, f"another process {what} there", hint)):
        try:
            yield
        finally:
            with suppress(OSError):  # it holds something, and so do those around it
                for path in made:
                    path.rmdir()


@contextmanager
def in_turn(lock: Path) -> Iterator[None]:
    """Wait until nobody else holds the file ``lock``, which is made and left; nobody is waited for without locks."""
    lock.parent.mkdir(parents=True, exist_ok=True)
    with _locked(lock, os.O_WRONLY | os.O_CREAT):
        yield


@contextmanager
def _locked(path: Path, flags: int, busy: ResourceError | None = None) -> Iterator[None]:
    """Hold ``path``, opened with ``flags``; where another does, ``busy`` is raised, or waited where that is None."""
    if find_spec("fcntl") is None:
        yield
        return
    import fcntl

    handle = os.open(path, flags, 0o666)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | (0 if busy is None else fcntl.LOCK_NB))
        except OSError as error:
            if busy is not None and isinstance(error, BlockingIOError):
                raise busy from None  # any other is that of a network drive without locks
        yield
    finally:
        os.close(handle)
