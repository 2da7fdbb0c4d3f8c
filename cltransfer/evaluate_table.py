"""Several methods in one table: CSV, Markdown and LaTeX, undefined values as such."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from .evaluate_many import CONFIDENCE, RESAMPLES, ClipScore, Interval
from .files import csv_text, write_json, write_text
from .report.metrics import number

Summary = Mapping[str, Mapping[str, Interval]]

_ESCAPES = {
    "\\": r"\textbackslash{}",
    "_": r"\_",
    "&": r"\&",
    "%": r"\%",
    "#": r"\#",
    "$": r"\$",
    "{": r"\{",
    "}": r"\}",
}


def write_methods(folder: Path, rows: Sequence[ClipScore], summary: Summary) -> None:
    """Write metrics.json, clips.csv, methods.csv, methods.md and methods.tex into ``folder``."""
    write_json(folder / "metrics.json", methods_json(rows, summary))
    write_text(folder / "clips.csv", clips_csv(rows))
    write_text(folder / "methods.csv", methods_csv(summary))
    write_text(folder / "methods.md", methods_markdown(summary) + "\n")
    write_text(folder / "methods.tex", methods_latex(summary))


def methods_json(rows: Sequence[ClipScore], summary: Summary) -> dict[str, Any]:
    """Plain values; what is undefined is null, with a reason."""
    return {
        "format": "cltransfer.methods",
        "version": 1,
        "interval": f"percentile bootstrap over clips, {RESAMPLES} resamples, {CONFIDENCE:.0%}",
        "methods": {m: {t: asdict(found) for t, found in terms.items()} for m, terms in summary.items()},
        "clips": [asdict(row) for row in rows],
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
    head = ["method", "term", "mean", "low", "high", "clips", "of", "frames", "reason"]
    return csv_text(
        [head, *([m, t, *asdict(found).values()] for m, terms in summary.items() for t, found in terms.items())]
    )


def methods_markdown(summary: Summary) -> str:
    """A row a method, a column a term: mean [low, high]; the best is bold.

    Clips that have a value are counted where not all have one, frames where another method has more.
    """
    terms, best, most = _terms(summary), _best(summary), _most_frames(summary)
    lines = [["method", *terms], ["---", *["--:"] * len(terms)]]
    for method, found in summary.items():
        cells = [_cell(found[t], most[t]) for t in terms]
        lines.append([method, *(f"**{c}**" if (method, t) in best else c for t, c in zip(terms, cells))])
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def methods_latex(summary: Summary) -> str:
    """The same table for LaTeX with booktabs."""
    terms, best, most = _terms(summary), _best(summary), _most_frames(summary)
    lines = [rf"\begin{{tabular}}{{l{'r' * len(terms)}}}", r"\toprule"]
    lines.append(" & ".join(["method", *map(_escaped, terms)]) + r" \\")
    lines.append(r"\midrule")
    for method, found in summary.items():
        cells = [_escaped(_cell(found[t], most[t]).replace("–", "--")) for t in terms]
        shown = [rf"\textbf{{{c}}}" if (method, t) in best else c for t, c in zip(terms, cells)]
        lines.append(" & ".join([_escaped(method), *shown]) + r" \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", ""])


def _terms(summary: Summary) -> list[str]:
    return list(dict.fromkeys(term for terms in summary.values() for term in terms))


def _most_frames(summary: Summary) -> dict[str, int]:
    """Frames that have a value in the method that has most, by term."""
    return {term: max(terms[term].defined for terms in summary.values()) for term in _terms(summary)}


def _best(summary: Summary) -> set[tuple[str, str]]:
    """Method and term of the lowest mean; none where a method lacks a clip, where another has more frames, or alone."""
    best = set()
    for term, most in _most_frames(summary).items():
        found = {method: terms[term] for method, terms in summary.items()}
        means = {method: value.mean for method, value in found.items() if value.mean is not None}
        if len(found) > 1 and means and all(value.clips == value.of for value in found.values()):
            lowest = min(means, key=lambda method: means[method])
            if found[lowest].defined == most:
                best.add((lowest, term))
    return best


def _cell(found: Interval, most: int) -> str:
    text = number(found.mean)
    if found.low is not None and found.high is not None:
        text += f" [{number(found.low)}, {number(found.high)}]"
    if found.clips < found.of:
        return f"{text} ({found.clips}/{found.of})"
    return text if found.defined == most else f"{text} ({found.defined}/{most} frames)"


def _escaped(text: str) -> str:
    return "".join(_ESCAPES.get(letter, letter) for letter in text)
