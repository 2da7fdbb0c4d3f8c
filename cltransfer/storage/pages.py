"""Folders of a page that was made here; one of anything else is not written over."""

from __future__ import annotations

import re
from pathlib import Path

from ..errors import UsageError
from .files import check_out, refuse_outside
from .foreign import head_holds
from .unfinished import holds_others

INDEX = "index.html"


def check_page(out: Path, mark: str, what: str) -> None:
    """Refuse a folder that holds something else than ``what``, a page whose head names ``mark`` as its generator.

    Raises:
        UsageError: it is no folder, or neither empty nor such a page.
        InputError: a part of it leads elsewhere; somebody else may have made the page.
    """
    check_out(out)
    ours = (out / INDEX).is_file() and head_holds(out / INDEX, f'content="{mark}"')
    if not ours and holds_others(out, re.compile(re.escape(INDEX))):
        raise UsageError(out, "--out", f"is neither empty nor {what}", "name another folder")
    refuse_outside(out, out.rglob("*"), "page")
