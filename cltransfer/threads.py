"""How many threads one process may use, decided in one place for every library."""

from __future__ import annotations

import os

from .errors import UsageError

VARIABLE = "CLTRANSFER_THREADS"


def thread_count() -> int:
    """Threads for this process: ``CLTRANSFER_THREADS``, else the CPUs it may run on.

    Raises:
        UsageError: the variable is not a positive whole number.
    """
    named = os.environ.get(VARIABLE)
    if named:
        if not named.isdecimal() or int(named) < 1:
            raise UsageError("", VARIABLE, f"expected a positive whole number, got {named!r}")
        return int(named)
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


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

    os.environ[VARIABLE] = str(count)
    torch.set_num_threads(tensors)
    cv2.setNumThreads(count)
