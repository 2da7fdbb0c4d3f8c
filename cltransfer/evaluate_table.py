"""Several methods in one table: CSV, Markdown and LaTeX, undefined values as such."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from .evaluate_kept import ClipScore
from .evaluate_many import CONFIDENCE, FEWEST, RESAMPLES, Interval
from .evaluate_paired import ALIKE, Difference, Differences
from .paired import FEWEST as FEWEST_PAIRS
from .paired import LEVEL
from .paired import RESAMPLES as PAIRED_RESAMPLES
from .report.estimates import DIFFERENCE, difference_cells, signed
from .report.metrics import number
from .report.tables import Table, escape, headed, to_latex, to_markdown
from .storage.files import csv_text, write_json, write_text
from .storage.run_files import METRICS

Summary = Mapping[str, Mapping[str, Interval]]
NONE: Differences = {}


def write_methods(
    folder: Path, rows: Sequence[ClipScore], summary: Summary, against: Differences, notes: Sequence[str] = ()
) -> None:
    """Write metrics.json, clips.csv, methods.csv, methods.md and methods.tex into ``folder``."""
    write_json(folder / METRICS, methods_json(rows, summary, against, notes))
    write_text(folder / "clips.csv", clips_csv(rows))
    write_text(folder / "methods.csv", methods_csv(summary, against))
    write_text(folder / "methods.md", methods_markdown(summary, against) + "\n")
    write_text(folder / "methods.tex", methods_latex(summary, against))


def methods_json(
    rows: Sequence[ClipScore], summary: Summary, against: Differences = NONE, notes: Sequence[str] = ()
) -> dict[str, Any]:
    """Plain values; what is undefined is null, with a reason; ``notes`` are on what is no row."""
    return {
        "format": "cltransfer.methods",
        "version": 1,
        "interval": f"bootstrap-t over clips, {FEWEST} or more, {RESAMPLES} resamples, {CONFIDENCE:.0%}, from 0 on",
        "methods": {m: {t: asdict(found) for t, found in terms.items()} for m, terms in summary.items()},
        "difference_interval": f"percentiles of the mean difference to the first method over clips that both have, "
        f"{FEWEST_PAIRS} or more, {PAIRED_RESAMPLES} resamples, {CONFIDENCE:.0%}; p of the signed-rank test",
        "differences": {m: {t: _told(found) for t, found in terms.items()} for m, terms in against.items()},
        "clips": [asdict(row) for row in rows],
        "notes": list(notes),
    }


def clips_csv(rows: Sequence[ClipScore]) -> str:
    """One row a clip and method: mean and defined frames of each term; undefined is an empty cell."""
    terms = list(dict.fromkeys(name for row in rows for name in row.means))
    head = ["method", "clip", "frames", *(f"{t}{end}" for t in terms for end in ("", "_defined")), "reason"]
    body = [
        [
            row.method,
            row.clip,
            row.frames,
            *(v for t in terms for v in (row.means.get(t), row.defined.get(t))),
            row.reason,
        ]
        for row in rows
    ]
    return csv_text([head, *body])


def _told(difference: Difference) -> dict[str, Any]:
    return {**asdict(difference.estimate), "alike": difference.alike, "certain": difference.certain}


def methods_csv(summary: Summary, against: Differences = NONE) -> str:
    """One row a method and term: mean, interval, difference to the first method, clips; undefined is an empty cell."""
    head = ["method", "term", "unit", "mean", "low", "high", *DIFFERENCE, "difference_alike", "clips", "of", "frames"]
    head += ["most_frames", "seconds", "most_seconds", "reason"]
    lines: list[list[Any]] = [head]
    for method, terms in summary.items():
        for term, found in terms.items():
            mean, low, high, *rest, unit = asdict(found).values()
            difference = against[method][term] if method in against else None
            compared = difference_cells(None if difference is None else difference.estimate)
            alike = "" if difference is None else difference.alike
            lines.append([method, term, unit, mean, low, high, *compared, alike, *rest])
    return csv_text(lines)


def methods_markdown(summary: Summary, against: Differences = NONE) -> str:
    """A row a method, a column a term: mean [low, high]; the best is bold where all have every clip and the same of it.

    Clips that have a value are counted where not all have one, frames and seconds where another method has more; an
    upper end that is not known is a dash. Below it stands what each method differs by from the first.
    """
    lines = to_markdown(_table(summary))
    if against:
        lines += [
            "",
            f"Less {escape(_first(summary))}, clip by clip, over the n clips that both have; bold: the interval",
            f"excludes zero and the signed-rank test has p at most {LEVEL}, of {FEWEST_PAIRS} clips or more that",
            "differ, and both have the same clips and as many frames of each, equally far apart.",
            "",
            *to_markdown(_differences_table(summary, against)),
        ]
    return "\n".join(lines)


def methods_latex(summary: Summary, against: Differences = NONE) -> str:
    """The same tables for LaTeX with booktabs."""
    tables = [_table(summary), *([_differences_table(summary, against)] if against else [])]
    return "\n\n".join("\n".join(to_latex(table)) for table in tables) + "\n"


def _table(summary: Summary) -> Table:
    terms, best = _terms(summary), _best(summary)
    rows = tuple((method, *(_cell(found[t]) for t in terms)) for method, found in summary.items())
    bold = {(i, j + 1) for i, method in enumerate(summary) for j, term in enumerate(terms) if (method, term) in best}
    return Table(("method", *_headers(summary)), rows, frozenset(bold))


def _differences_table(summary: Summary, against: Differences) -> Table:
    terms, rows, bold = _terms(summary), [], set()
    for i, (method, found) in enumerate(against.items()):
        rows.append((method, *(signed(found[term].estimate) for term in terms)))
        bold |= {(i, j + 1) for j, term in enumerate(terms) if found[term].certain}
    return Table((f"difference to {_first(summary)}", *_headers(summary)), tuple(rows), frozenset(bold))


def _headers(summary: Summary) -> list[str]:
    return [headed(t, (found[t].unit for found in summary.values())) for t in _terms(summary)]


def _first(summary: Summary) -> str:
    return next(iter(summary))


def _terms(summary: Summary) -> list[str]:
    return list(dict.fromkeys(term for terms in summary.values() for term in terms))


def _best(summary: Summary) -> set[tuple[str, str]]:
    """Method and term of the lowest mean, unless two share it, a method lacks a clip or has fewer frames of one.

    Movement is measured from frame to frame, so that who has fewer of them moves more, and less in a shorter time.
    """
    best = set()
    for term in _terms(summary):
        found = {method: terms[term] for method, terms in summary.items()}
        means = {method: value.mean for method, value in found.items() if value.mean is not None}
        if len(found) > 1 and means and all(value.clips == value.of for value in found.values()):
            lowest = [method for method, mean in means.items() if mean == min(means.values())]
            if len(lowest) == 1 and all(value.defined == value.most and _as_long(value) for value in found.values()):
                best.add((lowest[0], term))
    return best


def _cell(found: Interval) -> str:
    text = number(found.mean)
    if found.low is not None:
        text += f" [{number(found.low)}, {number(found.high)}]"
    if found.clips < found.of:
        return f"{text} ({found.clips}/{found.of})"
    if found.defined < found.most:
        return f"{text} ({found.defined}/{found.most} frames)"
    return text if _as_long(found) else f"{text} ({found.seconds:.2f}/{found.most_seconds:.2f} s)"


def _as_long(found: Interval) -> bool:
    """Whether no other method's frames are spread over more of the clips, to :data:`ALIKE`."""
    return found.seconds >= (1 - ALIKE) * found.most_seconds
