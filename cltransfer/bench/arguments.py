"""What the verbs of ``cltransfer bench`` share of their options."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

PAGE_LIMIT = 2**24  # bytes of a page of figures
LAST_SEED = 2**63  # that a config takes


def page(path: Path | None) -> Path | None:
    """``path`` where a section can be written into it, checked before anything is measured.

    Raises:
        UsageError: it is a folder, a device or a pipe.
        InputError: it is no text.
    """
    from ..storage.files import check_out_file, read_text

    check_out_file(path)
    if path is not None and path.exists():
        read_text(path, PAGE_LIMIT)
    return path


def folder(path: Path | None) -> Path | None:
    """``path`` where it can be a folder, checked before anything is measured.

    Raises:
        UsageError: there is a file of that name.
    """
    from ..storage.files import check_out

    if path is not None:
        check_out(path)
    return path


Out = Annotated[
    Path | None,
    typer.Option("--out", "-o", callback=page, help="Markdown file whose section is rewritten, of this bench."),
]
Jobs = Annotated[int, typer.Option(min=1, help="Trials at a time, one thread each.")]
