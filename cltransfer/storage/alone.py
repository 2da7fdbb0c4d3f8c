"""What one process at a time works in: a folder, where a second is refused, or a file, where it waits."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Iterator
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
    with _locked(folder, _to_read, ResourceError(folder, option, f"another process {what} there", hint)):
        try:
            yield
        finally:
            with suppress(OSError):  # it holds something, and so do those around it
                for path in made:
                    path.rmdir()


@contextmanager
def in_turn(lock: Path) -> Iterator[None]:
    """Wait until nobody else holds the file ``lock``, which is made and left; nobody is waited for without locks.

    It may be another user's, or lie on a drive that is not to be written.
    """
    lock.parent.mkdir(parents=True, exist_ok=True)
    with _locked(lock, _to_write):
        yield


def _to_read(path: Path) -> int:
    return os.open(path, os.O_RDONLY)


def _to_write(path: Path) -> int:
    """A file that is made where it is missing, and opened to be read alone only where it may not be written.

    On many a network drive a file that is not open to be written cannot be held.
    """
    try:
        return os.open(path, os.O_WRONLY | os.O_CREAT, 0o666)
    except OSError as error:
        if error.errno not in (errno.EACCES, errno.EPERM, errno.EROFS) or not path.is_file():
            raise
        return _to_read(path)


@contextmanager
def _locked(path: Path, opened: Callable[[Path], int], busy: ResourceError | None = None) -> Iterator[None]:
    """Hold ``path``, as it is ``opened``; where another does, ``busy`` is raised, or waited where that is None."""
    if find_spec("fcntl") is None:
        yield
        return
    import fcntl

    handle = opened(path)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | (0 if busy is None else fcntl.LOCK_NB))
        except OSError as error:
            if busy is not None and isinstance(error, BlockingIOError):
                raise busy from None  # any other is that of a network drive without locks
        yield
    finally:
        os.close(handle)
