"""What the rows of an ablation come to: means with bootstrap intervals, coverage, cost, and paired differences."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from statistics import fmean
from typing import Any

from ..paired import Estimate, change, estimate
from .outcome import Case, Metric, Outcome
from .read import DRAWN


@dataclass(frozen=True)
class Measure:
    """One metric of one row.

    Args:
        value: mean over references; a seed that draws a reference makes another; scenes, and other seeds, are averaged
            first.
        difference: to the first row, over the same of the cases on which both have a value; None in the first row.
        unit: of both.
        defined, frames: how many frames have a value, of how many.
    """

    value: Estimate
    difference: Estimate | None
    unit: str
    defined: int
    frames: int


@dataclass(frozen=True)
class RowSummary:
    """One row of the table.

    Args:
        name: in the file.
        trials, failed: how many, and how many of them without a result.
        metrics: by name, the total last.
        directions: which way the row errs, by name.
        evaluations: a frame, mean.
        seconds: a trial, mean over those with a result.
    """

    name: str
    trials: int
    failed: int
    metrics: dict[str, Measure]
    directions: dict[str, Measure]
    evaluations: float | None
    seconds: float | None


def summarise(rows: Iterable[str], outcomes: Iterable[Outcome]) -> list[RowSummary]:
    """One summary for each of ``rows``, in their order; the first is what the others are held against."""
    by_row: dict[str, list[Outcome]] = {name: [] for name in rows}
    for outcome in outcomes:
        by_row[outcome.row].append(outcome)
    first = next(iter(by_row.values()))
    kinds = [(kind, _names(kind, by_row.values())) for kind in ("metrics", "directions")]
    return [_row(name, found, None if found is first else first, kinds) for name, found in by_row.items()]


def alike(outcomes: Iterable[Outcome]) -> list[tuple[str, str]]:
    """Rows that came to the same on every case, in each value and at the same cost, each with the first such row."""
    rows: dict[str, dict[Case, tuple[Any, ...]]] = {}
    for o in outcomes:
        came = (o.failed, o.metrics, o.directions, o.frames, o.evaluations, o.network_passes)
        rows.setdefault(o.row, {})[o.case] = came
    names = [name for name, found in rows.items() if any(metrics is not None for _, metrics, *_ in found.values())]
    first = {name: next(other for other in names if rows[other] == rows[name]) for name in names}
    return [(other, name) for name, other in first.items() if other != name]


def _names(kind: str, rows: Iterable[list[Outcome]]) -> list[str]:
    """Everything of a ``kind``, metrics or directions, that some outcome tells."""
    return list(dict.fromkeys(name for found in rows for outcome in found for name in _told(outcome, kind)))


def _told(outcome: Outcome, kind: str) -> dict[str, Metric]:
    return getattr(outcome, kind) or {}


def _row(
    name: str, found: list[Outcome], first: list[Outcome] | None, kinds: list[tuple[str, list[str]]]
) -> RowSummary:
    done = [outcome for outcome in found if outcome.metrics is not None]
    evaluations = fmean(o.evaluations / o.frames for o in done) if done else None
    seconds = fmean(o.seconds for o in done) if done else None
    metrics, directions = ({n: _measure(kind, n, found, first) for n in names} for kind, names in kinds)
    return RowSummary(name, len(found), len(found) - len(done), metrics, directions, evaluations, seconds)


def _measure(kind: str, name: str, found: list[Outcome], first: list[Outcome] | None) -> Measure:
    values = _values(kind, name, found)
    difference = None
    if first is not None:
        held = _values(kind, name, first)
        difference = estimate(_observed({case: change(values[case], held[case]) for case in values if case in held}))
    terms = [(_told(outcome, kind)[name], outcome.frames) for outcome in found if name in _told(outcome, kind)]
    unit = terms[0][0].unit if terms else ""
    return Measure(
        estimate(_observed(values)), difference, unit, sum(t.defined for t, _ in terms), sum(n for _, n in terms)
    )


def _values(kind: str, name: str, found: list[Outcome]) -> dict[Case, float]:
    means = {o.case: _told(o, kind)[name].mean for o in found if name in _told(o, kind)}
    return {case: mean for case, mean in means.items() if mean is not None}


def _observed(values: dict[Case, float]) -> list[float]:
    """One value for each reference, its mean over scenes and, where it is fixed, over seeds.

    Seeds of a fixed reference show how steady a search is, and nothing of other shots: a search without chance comes to
    the same value for each of them. A drawn one is another for each seed. One shot in several scenes is the same shot:
    what is hard about it is hard in each of them, so its values go together, and as many would make an interval over
    shots too narrow. Of scenes an interval says nothing: they are those that are named.
    """
    found: dict[tuple[str, int | None], list[float]] = {}
    for case, value in values.items():
        found.setdefault(shot_of(case), []).append(value)
    return [fmean(of_one) for of_one in found.values()]


def shot_of(case: Case) -> tuple[str, int | None]:
    """What of a case counts as one observation: its reference, and the seed that has drawn it.

    >>> shot_of(Case("courtyard", "clip.mp4", 3)), shot_of(Case("courtyard", "drawn:pan", 3))
    (('clip.mp4', None), ('drawn:pan', 3))
    """
    return case.reference, case.seed if case.reference.startswith(DRAWN) else None
