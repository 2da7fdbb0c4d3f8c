"""Where compiled kernels are kept, so that no change of a source leaves old machine code in use.

Numba keys its cache by the file of a function and does not look at what that takes from others. So the folder is named
by the content of all sources of kernels.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import re
import shutil
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

from ..storage.files import cache_dir
from .numba_settings import numba

PACKAGE = Path(__file__).parents[1]
SOURCES = ("*/_kernels.py", "*/kernels/*.py")
UNUSED = 30 * 24 * 3600  # [s] after which what other sources were compiled to is deleted
NAME = re.compile("kernels-[0-9a-f]{16}")  # of a folder; anybody may keep others beside them

_log = logging.getLogger("cltransfer")
_CONFIG: Any = numba.config
_DECORATING = threading.Lock()


def kernel(**options: Any) -> Callable[[Any], Any]:
    """``numba.njit`` with ``options``, whose machine code is kept in :func:`folder`; compiled at each start without."""

    def compiled(function: Any) -> Any:
        with _kept() as place:
            made = numba.njit(cache=place is not None, **options)(function)
        if place is not None and hasattr(made, "_cache"):  # a plain function under NUMBA_DISABLE_JIT
            made._cache.save_overload = _if_it_can(made._cache.save_overload, place)
        return made

    return compiled


def _if_it_can(save: Callable[..., None], place: Path) -> Callable[..., None]:
    """``save``, which a full disk ends after the kernel has been compiled: it can be called, only not kept."""

    def saved(*given: Any) -> None:
        try:
            save(*given)
        except OSError as error:
            _tell(place, error.strerror or str(error))

    return saved


@cache
def _tell(place: Path, reason: str) -> None:
    """Once, of however many kernels."""
    _log.warning("%s: %s: each start compiles kernels anew", place, reason)


@contextlib.contextmanager
def _kept() -> Iterator[Path | None]:
    """Numba keeps in :func:`folder` alone; it asks its settings, which threads share, when a function is decorated."""
    with _DECORATING:
        place, usual = folder(), {name: getattr(_CONFIG, name, "") for name in ("CACHE_DIR", "CACHE_LOCATOR_CLASSES")}
        vars(_CONFIG).update(CACHE_DIR=str(place or ""), CACHE_LOCATOR_CLASSES="")
        try:
            yield place
        finally:
            vars(_CONFIG).update(usual)


@cache
def folder() -> Path | None:
    """The first folder that can be written, ``NUMBA_CACHE_DIR``, beside the sources or in the cache; None without."""
    name = f"kernels-{_content()}"
    for place in _places():
        with contextlib.suppress(OSError, RuntimeError):
            return _opened(place() / name)
    return None


def _places() -> Iterator[Callable[[], Path]]:
    if named := os.environ.get("NUMBA_CACHE_DIR"):
        yield lambda: Path(named)
    yield lambda: PACKAGE / "__pycache__"
    yield cache_dir


def _content() -> str:
    told = hashlib.sha256()
    for path in sorted(path for pattern in SOURCES for path in PACKAGE.glob(pattern)):
        told.update(f"{path.relative_to(PACKAGE).as_posix()} {path.stat().st_size} ".encode() + path.read_bytes())
    return told.hexdigest()[:16]


def _opened(place: Path) -> Path:
    """``place``, made where it was not; what lay beside it unused is deleted then.

    Raises:
        OSError: it cannot be written.
    """
    if not place.is_dir():
        place.mkdir(parents=True, exist_ok=True)
        for other in place.parent.iterdir():
            if NAME.fullmatch(other.name) and _unused(other):
                shutil.rmtree(other, ignore_errors=True)
    tempfile.TemporaryFile(dir=place).close()
    os.utime(place)  # it is in use
    return place


def _unused(place: Path) -> bool:
    try:
        return time.time() - place.stat().st_mtime > UNUSED
    except OSError:  # another process has deleted it
        return False
