"""How many threads one process may use, decided in one place for every library."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

from ..errors import UsageError

MOST = 1024  # threads that anybody means
VARIABLE = "CLTRANSFER_THREADS"
_set: tuple[str, int] = ("nothing", 0)  # what set_threads has written there, and what had been asked for before


def thread_count() -> int:
    """Threads for this process: ``CLTRANSFER_THREADS``, else the CPUs it may run on.

    Raises:
        UsageError: the variable is not a positive whole number.
    """
    named = os.environ.get(VARIABLE)
    if named:
        if not named.isdecimal() or len(named) > len(str(MOST)) or not 1 <= int(named) <= MOST:
            raise UsageError("", VARIABLE, f"expected a positive whole number up to {MOST}, got {named!r:.40}")
        return int(named)
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def default_count() -> int:
    """Threads of a run that names no count: :func:`thread_count`, whatever an earlier run in this process was given.

    Raises:
        UsageError: the variable is not a positive whole number.
    """
    written, asked = _set
    return asked if os.environ.get(VARIABLE) == written else thread_count()


def set_threads(count: int, tensors: int = 1) -> None:
    """Let kernels, OpenCV, networks opened from now on and child processes use ``count`` threads each.

    torch's own operations get ``tensors``. One by default: what is left to them is small, and threads that wait for
    each other at every sum take four times as long as one where other programs want the cores too.

    Raises:
        ValueError: a count is not positive.
    """
    if min(count, tensors) < 1:
        raise ValueError(f"threads must be at least 1, got {count} and {tensors}")
    import cv2
    import torch

    global _set
    _set = (str(count), default_count())
    os.environ[VARIABLE] = str(count)
    torch.set_num_threads(tensors)
    cv2.setNumThreads(count)


@contextmanager
def threads_restored() -> Iterator[None]:
    """Afterwards threads are as they were before the block, which sets them: they are those of the whole process."""
    import cv2
    import torch

    global _set
    before, named, tensors, views = _set, os.environ.get(VARIABLE), torch.get_num_threads(), cv2.getNumThreads()
    try:
        yield
    finally:
        _set = before
        os.environ.pop(VARIABLE, None)
        if named is not None:
            os.environ[VARIABLE] = named
        torch.set_num_threads(tensors)
        cv2.setNumThreads(views)
