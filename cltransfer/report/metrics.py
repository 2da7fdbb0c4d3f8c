"""The metrics as files and as a table. A value that is undefined is null with its reason, never NaN."""

from __future__ import annotations

import io
import math
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torch import Tensor

from ..pipeline.scores import Scores, Term
from ..storage.files import csv_text, write_json, write_text
from ..storage.run_files import METRICS, METRICS_CSV
from .data import ReportData
from .tables import markdown_lines

HEAD = ("metric", "mean", "unit", "weighted", "coverage", "first view", "first view / mean")
WITHOUT_BASELINE = 5  # columns of the head that need none
FIRST_VIEW = """first view: the camera stays where the first frame stands;
the last column is how many times worse that is"""  # in two lines that a terminal has room for
WORDS = (0, 2)  # columns of it that hold no numbers
GAP, NARROW = 2, 10  # letters between two columns in a terminal, and of a name there at the least


@dataclass(frozen=True)
class Row:
    """One line of the summary.

    Args:
        name: of the term, or "total".
        unit: of ``mean`` and ``baseline``.
        mean: raw mean over the frames that have a value, None where none has.
        weighted: what it adds to the total on average.
        defined, frames: how many frames have a value, of how many.
        baseline: the same mean for the first view held still.
        reason: why values are missing.
    """

    name: str
    unit: str
    mean: float | None
    weighted: float | None
    defined: int
    frames: int
    baseline: float | None
    reason: str

    @property
    def ratio(self) -> float | None:
        """How many times larger the baseline is, None where that cannot be said."""
        if self.mean is None or self.baseline is None or self.mean <= 0:
            return None
        return self.baseline / self.mean

    def cells(self) -> tuple[str, ...]:
        """Text under :data:`HEAD`."""
        ratio = "–" if self.ratio is None else f"{number(self.ratio)}×"
        coverage = f"{self.defined}/{self.frames}"
        return (
            self.name,
            number(self.mean),
            self.unit,
            number(self.weighted),
            coverage,
            number(self.baseline),
            ratio,
        )


def rows(report: ReportData) -> tuple[Row, ...]:
    """One row per term, then the total."""
    found = [_row(term, report.baseline) for term in report.scores.terms]
    total = Term("total", "", 1.0, report.scores.totals)
    against = None if report.baseline is None else Term("total", "", 1.0, report.baseline.totals).mean
    why = "" if total.defined else "no term is defined on any frame of the reference"
    return (*found, Row("total", "", total.mean, total.mean, total.defined, len(total.values), against, why))


def _row(term: Term, baseline: Scores | None) -> Row:
    other = None if baseline is None else baseline.term(term.name)
    weighted = None if term.mean is None else term.weight * term.mean
    against = None if other is None else other.mean
    return Row(term.name, term.unit, term.mean, weighted, term.defined, len(term.values), against, term.reason)


def number(value: float | None) -> str:
    """Three significant digits, whole numbers in full; a dash where there is no value.

    >>> number(0.0123456), number(0.1), number(1234.5), number(7), number(None)
    ('0.0123', '0.100', '1234', '7', '–')
    >>> number(999.7)
    '1000'
    """
    if value is None or not math.isfinite(value):
        return "–"
    if isinstance(value, int) or abs(value) >= 999.5:
        return f"{value:.0f}"
    return f"{value:#.3g}".rstrip(".")


def head(report: ReportData) -> tuple[str, ...]:
    """The columns of :data:`HEAD` that ``report`` can fill."""
    return HEAD[:WITHOUT_BASELINE] if report.baseline is None else HEAD


def sums(report: ReportData) -> str:
    """How the weighted means go into the total, where they do not add up to it; else empty."""
    *terms, total = rows(report)
    added = sum(row.weighted or 0.0 for row in terms)
    if total.mean is None or math.isclose(added, total.mean, rel_tol=0.005):
        return ""
    charged = report.scores.totals - sum(term.weight * term.values.nan_to_num() for term in report.scores.terms)
    price = ", where only the render lacks a term it costs its penalty" if bool((charged > 1e-6).any()) else ""
    return f"weighted: mean over the frames that have the term; total: mean over all frames{price}"


def compared(report: ReportData) -> str:
    """What the columns of the first view say, where they are there; else empty."""
    return FIRST_VIEW if report.baseline is not None else ""


def metrics_table(report: ReportData, terminal: bool | None = None) -> str:
    """Table of the metrics: drawn for a terminal, Markdown otherwise; below it what its columns mean.

    ``terminal`` is whether it will be seen in one; None looks at standard output. In one that is too narrow for the
    numbers it is Markdown too, whose lines are broken there.
    """
    names = head(report)
    lines = [row.cells()[: len(names)] for row in rows(report)]
    seen = sys.stdout.isatty() if terminal is None else terminal
    if seen and (widths := _widths(names, lines, shutil.get_terminal_size().columns)):
        table = _drawn(names, lines, widths)
    else:
        table = "\n".join(markdown_lines(names, lines, WORDS))
    return "\n\n".join(filter(None, [table, sums(report), compared(report)]))


def _widths(names: tuple[str, ...], lines: list[tuple[str, ...]], columns: int) -> list[int]:
    """Letters of each column in ``columns`` of a terminal, where numbers stay whole; empty where they would not.

    What is wider than that goes on below: first heads of numbers, the last one first, then units, then names.
    """
    numbers = [i for i in range(len(names)) if i not in WORDS]
    widths = [max(map(len, column)) for column in zip(names, *lines)]
    least = [max(map(len, " ".join(column).split())) for column in zip(names, *lines)]  # no word is broken,
    least[0] = min(least[0], NARROW)  # but a long name is
    over = sum(widths) + GAP * (len(widths) - 1) - columns
    for i in (*reversed(numbers), *reversed(WORDS)):
        given = min(max(over, 0), widths[i] - least[i])
        widths[i] -= given
        over -= given
    return widths if over <= 0 else []


def _drawn(names: tuple[str, ...], lines: list[tuple[str, ...]], widths: list[int]) -> str:
    """Columns of ``widths`` without colour: what a terminal would act on is escaped where it is printed."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False)
    for i, (name, width) in enumerate(zip(names, widths)):
        table.add_column(name, justify="left" if i in WORDS else "right", width=width, overflow="fold")
    for cells in lines:
        table.add_row(*(Text(cell) for cell in cells))
    console = Console(file=io.StringIO(), width=sum(widths) + GAP * len(widths), color_system=None)
    console.print(table)
    return "\n".join(line.rstrip() for line in console.file.getvalue().splitlines())  # type: ignore[attr-defined]


def write_metrics(run: Path, report: ReportData) -> None:
    """Write ``metrics.json`` (means, coverage, reasons) and ``metrics.csv`` (one row per frame) into ``run``."""
    write_json(run / METRICS, metrics_json(report))
    write_text(run / METRICS_CSV, metrics_csv(report))


def metrics_json(report: ReportData) -> dict[str, Any]:
    """Plain values for ``metrics.json``."""
    return {
        "format": "cltransfer.metrics",
        "version": 1,
        "title": report.title,
        "frames": len(report.times),
        "seconds_apart": report.apart,
        "metrics": {row.name: _row_json(row, report) for row in rows(report)},
        "flags": [{"frame": flag.frame, "reason": flag.reason} for flag in report.flags],
        "spent": {name: finite(value) if isinstance(value, float) else value for name, value in report.spent.items()},
        "command": report.command or None,
    }


def _row_json(row: Row, report: ReportData) -> dict[str, Any]:
    term = report.scores.term(row.name)
    values: Tensor = report.scores.totals if term is None else term.values
    return {
        "mean": row.mean,
        "unit": row.unit,
        "weighted": row.weighted,
        "defined": row.defined,
        "frames": row.frames,
        "reason": row.reason or Term(row.name, row.unit, 1.0, values).why_not,
        "first_view": row.baseline,
        "ratio": row.ratio,
        "values": [finite(value) for value in values.tolist()],
    }


def metrics_csv(report: ReportData) -> str:
    """Frame, time, each raw term, weighted total and flags; undefined is an empty cell."""
    names = [term.name for term in report.scores.terms]
    lines: list[list[Any]] = [["frame", "time", *names, "total", "flags"]]
    columns = [term.values.tolist() for term in report.scores.terms]
    for frame, (time, total) in enumerate(zip(report.times.tolist(), report.scores.totals.tolist())):
        flags = "; ".join(flag.reason for flag in report.flags if flag.frame == frame)
        values = [finite(column[frame]) for column in columns]
        lines.append([frame, time, *values, finite(total), flags])
    return csv_text(lines)


def finite(value: float) -> float | None:
    """The value itself, None where it is NaN or infinite."""
    return value if math.isfinite(value) else None
