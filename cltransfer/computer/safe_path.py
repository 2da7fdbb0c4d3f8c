"""Processes of Python that are started here take no modules from the folder we are in, which may be a stranger's."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

VARIABLE = "PYTHONSAFEPATH"


@contextmanager
def safe_path() -> Iterator[None]:
    """Whatever ``python -m`` or ``-c`` is started in the block, by libraries too, and what that starts, is so.

    What was found in that folder by this process, as after ``python -m cltransfer`` there, is known to workers all the
    same: they are told where this one looks.
    """
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = "1"
    try:
        yield
    finally:
        os.environ.pop(VARIABLE, None)
        if before is not None:
            os.environ[VARIABLE] = before
