"""What the verbs of ``cltransfer bench`` share of their options."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

LAST_SEED = 2**63  # that a config takes


def page(context: typer.Context, path: Path | None) -> Path | None:
    """``path`` where the verb's section can be written into it, checked before anything is measured.

    Raises:
        UsageError: it is a folder, a device or a pipe.
        InputError: it is no text, or the section's markers are damaged.
    """
    from .pages import SECTIONS, check_page

    if path is not None:
        check_page(path, SECTIONS[str(context.info_name)])
    return path


def page_folder(context: typer.Context, path: Path | None) -> Path | None:
    """``path`` where it can be a folder with a page ``benchmarks.md``, see :func:`page`."""
    folder(path)
    if path is not None:
        page(context, path / "benchmarks.md")
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


def command_line() -> str:
    """The command that runs, for the page that it makes."""
    return shlex.join(["cltransfer", *sys.argv[1:]])


Out = Annotated[
    Path | None,
    typer.Option("--out", "-o", callback=page, help="Markdown file whose section is rewritten, of this bench."),
]
Jobs = Annotated[int, typer.Option(min=1, help="Trials at a time, one thread each.")]
