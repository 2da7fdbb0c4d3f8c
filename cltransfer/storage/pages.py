"""Folders of a page that was made here; one of anything else is not written over."""

from __future__ import annotations

import re
from pathlib import Path

from ..errors import UsageError
from .files import check_out, refuse_outside
from .unfinished import holds_others

INDEX = "index.html"
HEAD = 4096  # bytes of a page within which its mark stands


def check_page(out: Path, mark: str, what: str) -> None:
    """Refuse a folder that holds something else than ``what``, a page whose head names ``mark`` as its generator.

    Raises:
        UsageError: it is no folder, or neither empty nor such a page.
        InputError: a part of it leads elsewhere; somebody else may have made the page.
    """
    check_out(out)
    if holds_others(out, re.compile(re.escape(INDEX))) and not _is_page(out / INDEX, mark):
        raise UsageError(out, "--out", f"is neither empty nor {what}", "name another folder")
    refuse_outside(out, out.rglob("*"), "page")


def _is_page(index: Path, mark: str) -> bool:
    if not index.is_file():
        return False
    with index.open("rb") as stream:
        return f'content="{mark}"'.encode() in stream.read(HEAD)
