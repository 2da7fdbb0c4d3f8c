"""Every stressed trial as a line of a table, so that others can count otherwise."""

from __future__ import annotations

from collections.abc import Sequence

from ...storage.files import csv_text
from ..trial import Row

COLUMNS = ("method", "stressor", "level", "value", "shot", "teacher", "pupil", "seed", "frames", "total",
           "random_total", "failed", "reasons", "commit")  # fmt: skip


def trials_csv(rows: Sequence[Row]) -> str:
    """One line a trial, see :data:`COLUMNS`: the judge's total, that of random views, frames by why they failed.

    A level of 0 is without stress; ``reasons`` is empty where no frame failed by itself.
    """
    return csv_text([COLUMNS, *([_cell(row.get(name)) for name in COLUMNS] for row in rows)], 5)


def _cell(value: object) -> object:
    if isinstance(value, dict):
        return " ".join(f"{name}:{count}" for name, count in value.items())
    return int(value) if isinstance(value, bool) else value
