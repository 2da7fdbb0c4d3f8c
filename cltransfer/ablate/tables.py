"""The summary of an ablation: every number as CSV, and tables to be read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from ..report.estimates import DIFFERENCE, difference_cells, interval_text, numbers, signed, with_sign
from ..report.metrics import number
from ..report.tables import Table, escape, headed
from ..storage.files import csv_text
from .outcome import Outcome
from .summary import Measure, RowSummary

COST = ("evaluations a frame", "seconds a trial")
CSV_HEADER = (
    *("row", "metric", "unit", "mean", "low", "high", "count"),
    *DIFFERENCE,
    *("defined_frames", "frames", "trials", "failed", "evaluations_per_frame", "seconds_per_trial"),
)


def values_table(rows: Sequence[RowSummary]) -> Table:
    """Mean [interval] of every metric, coverage where it is not whole, failures and cost."""
    names = _metrics(rows)
    header = ("row", "trials", "failed", *_headers(rows), *COST)
    cells = []
    for row in rows:
        values = [_value(row.metrics[name]) for name in names]
        cost = (number(row.evaluations), number(row.seconds))
        cells.append((row.name, str(row.trials), str(row.failed), *values, *cost))
    return Table(header, tuple(cells))


def differences_table(rows: Sequence[RowSummary]) -> Table:
    """Paired differences of every row to the first."""
    names = _metrics(rows)
    cells, bold = [], set()
    for i, row in enumerate(rows[1:]):
        found = [row.metrics[name].difference for name in names]
        bold |= {(i, j + 1) for j, difference in enumerate(found) if difference and difference.certain}
        cells.append((row.name, *(signed(difference) for difference in found)))
    return Table((f"difference to {rows[0].name}", *_headers(rows)), tuple(cells), frozenset(bold))


def directions_table(rows: Sequence[RowSummary]) -> Table:
    """Which way every row errs: signed means, bold where apart from the first row's, case by case."""
    names = list(rows[0].directions)
    found = [[row.directions[name] for name in names] for row in rows]
    cells = [(row.name, *(_value(m, with_sign) for m in measures)) for row, measures in zip(rows, found)]
    bold = {
        (i, j + 1)
        for i, measures in enumerate(found)
        for j, measure in enumerate(measures)
        if measure.difference is not None and measure.difference.certain
    }
    header = [headed(name, (row.directions[name].unit for row in rows)) for name in names]
    return Table(("which way", *header), tuple(cells), frozenset(bold))


def _metrics(rows: Sequence[RowSummary]) -> list[str]:
    return list(rows[0].metrics)


def _headers(rows: Sequence[RowSummary]) -> list[str]:
    return [headed(name, (row.metrics[name].unit for row in rows)) for name in _metrics(rows)]


def _value(measure: Measure, told: Callable[[float | None], str] = number) -> str:
    text = interval_text(measure.value, told)
    whole = measure.defined == measure.frames
    return text if whole else f"{text} ({measure.defined}/{measure.frames})"


def to_csv(rows: Sequence[RowSummary]) -> str:
    """One line for each row and metric; what is not known is an empty cell.

    Counts are of references, which means and intervals are over; bold is a difference by :attr:`Estimate.certain`.
    """
    lines: list[Sequence[Any]] = [CSV_HEADER]
    for row in rows:
        cost = [row.trials, row.failed, row.evaluations, row.seconds]
        for name, m in [*row.metrics.items(), *row.directions.items()]:
            lines.append(
                [row.name, name, m.unit, *numbers(m.value), *difference_cells(m.difference), m.defined, m.frames, *cost]
            )
        if not row.metrics:
            lines.append([row.name, *[""] * (len(CSV_HEADER) - 1 - len(cost)), *cost])
    return csv_text(lines)


def failure_lines(outcomes: Sequence[Outcome]) -> list[str]:
    """One line for each failed trial: row, case and reason."""
    return [
        f"- {escape(f'{o.row}, {o.case.reference} in {o.case.scene}, seed {o.case.seed}: {o.failed}')}"
        for o in outcomes
        if o.failed
    ]
