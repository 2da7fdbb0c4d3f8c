"""Benchmarks in a Markdown page: each bench rewrites its own section and leaves the others."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch

from ..computer.processor import load_average, processor
from ..computer.revision import commit
from ..report.tables import escape, markdown_lines
from ..storage.files import write_text
from .pages import markers, page_text


def quartiles(times: Sequence[float]) -> tuple[float, float, float]:
    """Lower quartile, median and upper quartile."""
    low, median, high = statistics.quantiles(times, n=4, method="inclusive")
    return low, median, high


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a Markdown table, all columns to the left."""
    shown = [[escape(cell) for cell in cells] for cells in (header, *rows)]
    return markdown_lines(shown[0], shown[1:], words=range(len(header)))


def machine(rows: Sequence[Mapping[str, Any]] | None = None) -> list[str]:
    """Lines that say what was measured on, under what load, and by which commit.

    Args:
        rows: that were kept, each with its load average, machine and torch; older ones have none. None: all was
            measured just now.
    """
    load = _load([{"load": load_average()}] if rows is None else rows)
    return [
        f"Machine: {_each(rows, 'machine', processor())}{load};",
        f"torch {_each(rows, 'torch', torch.__version__)}; commit {commit()}.",
    ]


def _each(rows: Sequence[Mapping[str, Any]] | None, name: str, here: str) -> str:
    """All values of ``name`` among ``rows``; where none tells one, ``here``."""
    if not rows:
        return here
    known = sorted({str(row[name]) for row in rows if name in row})
    untold = ["one that older rows do not tell"] if known and not all(name in row for row in rows) else []
    return " and ".join([*known, *untold]) or here


def _load(rows: Sequence[Mapping[str, Any]]) -> str:
    """The range of the load averages that ``rows`` tell, and how many do; empty where none does."""
    known = [row["load"] for row in rows if row.get("load") is not None]
    if not known:
        return ""
    span = " to ".join(dict.fromkeys(f"{load:.1f}" for load in (min(known), max(known))))
    some = "" if len(known) == len(rows) else f"{len(known)} of {len(rows)} rows were "
    return f", load average {span} while {some}measured"


def write_section(path: Path, title: str, lines: Sequence[str]) -> None:
    """Put ``lines`` into the Markdown file ``path``, between two marker comments that it gets where it has none.

    Raises:
        InputError: the page is no text, or only one of the two stands in it, or the end before the begin.
    """
    begin, end = markers(title)
    section = "\n".join([begin, *lines, end])
    text = page_text(path, title)
    if begin in text:
        head, _, rest = text.partition(begin)
        text = head + section + rest.partition(end)[2]
    else:
        text = f"{text.rstrip()}\n\n## {title}\n\n{section}\n"
    write_text(path, text)
