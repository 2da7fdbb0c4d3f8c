"""Several methods in one table: CSV, Markdown and LaTeX, undefined values as such."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from .evaluate_kept import ClipScore
from .evaluate_many import CONFIDENCE, FEWEST, RESAMPLES, Interval
from .report.metrics import number
from .report.tables import Table, to_latex, to_markdown
from .storage.files import csv_text, write_json, write_text
from .storage.run_files import METRICS

ALIKE = 0.01  # by which the time may differ that as many frames are spread over: the nearest to even ones are taken

Summary = Mapping[str, Mapping[str, Interval]]


def write_methods(folder: Path, rows: Sequence[ClipScore], summary: Summary, notes: Sequence[str] = ()) -> None:
    """Write metrics.json, clips.csv, methods.csv, methods.md and methods.tex into ``folder``."""
    write_json(folder / METRICS, methods_json(rows, summary, notes))
    write_text(folder / "clips.csv", clips_csv(rows))
    write_text(folder / "methods.csv", methods_csv(summary))
    write_text(folder / "methods.md", methods_markdown(summary) + "\n")
    write_text(folder / "methods.tex", methods_latex(summary))


def methods_json(rows: Sequence[ClipScore], summary: Summary, notes: Sequence[str] = ()) -> dict[str, Any]:
    """Plain values; what is undefined is null, with a reason; ``notes`` are on what is no row."""
    return {
        "format": "cltransfer.methods",
        "version": 1,
        "interval": f"bootstrap-t over clips, {FEWEST} or more, {RESAMPLES} resamples, {CONFIDENCE:.0%}, from 0 on",
        "methods": {m: {t: asdict(found) for t, found in terms.items()} for m, terms in summary.items()},
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


def methods_csv(summary: Summary) -> str:
    """One row a method and term: mean, interval, clips; undefined is an empty cell."""
    head = ["method", "term", "mean", "low", "high", "clips", "of", "frames", "most_frames"]
    head += ["seconds", "most_seconds", "reason"]
    return csv_text(
        [head, *([m, t, *asdict(found).values()] for m, terms in summary.items() for t, found in terms.items())]
    )


def methods_markdown(summary: Summary) -> str:
    """A row a method, a column a term: mean [low, high]; the best is bold where all have every clip and the same of it.

    Clips that have a value are counted where not all have one, frames and seconds where another method has more; an
    upper end that is not known is a dash.
    """
    return "\n".join(to_markdown(_table(summary)))


def methods_latex(summary: Summary) -> str:
    """The same table for LaTeX with booktabs."""
    return "\n".join([*to_latex(_table(summary)), ""])


def _table(summary: Summary) -> Table:
    terms, best = _terms(summary), _best(summary)
    rows = tuple((method, *(_cell(found[t]) for t in terms)) for method, found in summary.items())
    bold = {(i, j + 1) for i, method in enumerate(summary) for j, term in enumerate(terms) if (method, term) in best}
    return Table(("method", *terms), rows, frozenset(bold))


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
