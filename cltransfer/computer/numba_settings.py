"""Numba, set by its environment variables alone.

It would also read a file of settings from whatever folder we are in, which may be a stranger's: they name where machine
code is kept, which is run, and whether anything is compiled at all. Import this before anything of Numba.
"""

from __future__ import annotations

import os
from types import ModuleType
from typing import Any

FILE = ".numba_config.yaml"
NOWHERE = "\0"  # which no file is called


def _unset() -> ModuleType:
    """Numba, which finds no such file: while it is imported, it has no other name for one yet."""
    system: Any = os.path
    exists = system.exists
    system.exists = lambda path: path != FILE and exists(path)
    try:
        import numba
        import numba.core.config
    finally:
        system.exists = exists
    settings: Any = numba.core.config
    settings._config_fname = NOWHERE
    settings.reload_config()  # what another has imported has read it
    return numba


numba = _unset()
