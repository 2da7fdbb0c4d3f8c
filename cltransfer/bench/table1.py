"""Table 1 of the paper on our own protocol: a baseline against ours on the five metrics, paired clip by clip."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..paired import FEWEST, LEVEL, Estimate
from ..registry import LOSSES
from ..report.metrics import number as written
from ..report.tables import Table, to_latex, to_markdown
from ..storage.files import csv_text, write_text
from .compare import Comparison, compared, together
from .measures import SIDE_MEASURES, failed_frames, is_self, paired, term
from .methods import TERMS
from .pages import SECTIONS
from .rows import measured_at
from .section import machine, write_section
from .trial import Row

CSV_HEADER = (
    *("baseline", "ours", "kind", "frames", "metric", "unit", "baseline_mean", "baseline_low", "baseline_high"),
    *("ours_mean", "ours_low", "ours_high", "difference_mean", "difference_low", "difference_high"),
    *("n", "wins", "p", "p_holm"),
)


CHOICES = ("all", "sound", "sound clips", "all")  # of frames, for the tables of a duel


@dataclass(frozen=True)
class Duel:
    """A baseline against ours.

    Args:
        baseline, ours: methods.
        kind: cross (another scene) or self (the scene of the reference: the true cameras are known).
        clips: how many both have run.
        all_frames: the five metrics over all frames, failed ones among them.
        sound_frames: the same without frames that failed by either method.
        sound_clips: the same of clips alone that failed by neither, as the paper leaves out what failed severely.
        beside: what else is measured; one by one, without correction.
    """

    baseline: str
    ours: str
    kind: str
    clips: int
    all_frames: tuple[Comparison, ...]
    sound_frames: tuple[Comparison, ...]
    sound_clips: tuple[Comparison, ...]
    beside: tuple[Comparison, ...]


def duels(rows: Sequence[Row], baselines: Sequence[str], ours: str) -> list[Duel]:
    """Ours against every baseline, across scenes and within them."""
    found = []
    for kind in ("cross", "self"):
        of_kind = [row for row in rows if is_self(row) == (kind == "self")]
        found += [duel(of_kind, baseline, ours, kind) for baseline in baselines if paired(of_kind, baseline, ours)]
    return found


def duel(rows: Sequence[Row], baseline: str, ours: str, kind: str) -> Duel:
    """Compare two methods on the clips that both have run."""
    pairs = paired(rows, baseline, ours)

    def five(pairs: Sequence[tuple[Row, Row]], without_failed: bool) -> tuple[Comparison, ...]:
        found = []
        for name in TERMS:
            values = [
                [
                    term(row, name, failed_frames(a) | failed_frames(b) if without_failed else frozenset())
                    for row in (a, b)
                ]
                for a, b in pairs
            ]
            found.append(compared(name, _unit(name), [a for a, _ in values], [b for _, b in values]))
        return tuple(together(found))

    beside = [
        compared(name, unit, [measure(a) for a, _ in pairs], [measure(b) for _, b in pairs])
        for name, (unit, measure) in SIDE_MEASURES.items()
    ]
    shown = tuple(c for c in beside if c.difference.count)
    sound = [(a, b) for a, b in pairs if not (a["failed_clip"] or b["failed_clip"])]
    return Duel(baseline, ours, kind, len(pairs), five(pairs, False), five(pairs, True), five(sound, True), shown)


def _unit(name: str) -> str:
    return str(LOSSES.build(name).unit)


def comparison_table(comparisons: Sequence[Comparison], baseline: str, ours: str) -> Table:
    """Means, difference with its interval (bold where certain, by the corrected p where there is one), wins, tests."""
    header = ("metric", "unit", baseline, ours, "difference [95 %]", "lower on", "p", "p, Holm", "clips")
    cells = [
        (c.name, c.unit, written(c.baseline.mean), written(c.ours.mean), _interval(c.difference), *tests)
        for c in comparisons
        for tests in [(_share(c.wins), _p(c.p), _p(c.p_holm), str(c.difference.count))]
    ]
    certain = frozenset((i, 4) for i, c in enumerate(comparisons) if c.difference.certain and not c.p_holm > LEVEL)
    return Table(header, tuple(cells), certain)


def _interval(estimate: Estimate) -> str:
    if estimate.low is None:
        return written(estimate.mean)
    return f"{written(estimate.mean)} [{written(estimate.low)}, {written(estimate.high)}]"


def _share(value: float) -> str:
    return f"{100 * value:.0f} %" if math.isfinite(value) else "–"


def _p(value: float) -> str:
    if not math.isfinite(value):
        return "–"
    return f"{value:.2g}" if value >= 1e-4 else "< 0.0001"


def markdown(found: Sequence[Duel]) -> list[str]:
    """All duels as Markdown."""
    lines: list[str] = []
    for d in found:
        where = "across scenes" if d.kind == "cross" else "within a scene (true cameras known)"
        analogue = ", but that no loss asks for a camera like the reference's in another scene" * (d.kind == "cross")
        tables = (
            ("All frames, failed ones among them; an undefined term pays its penalty.", d.all_frames),
            ("Without the frames that failed by either method.", d.sound_frames),
            ("Without the clips that failed by either method, nor such frames of the others.", d.sound_clips),
            (f"Beside them, one by one, without correction; lower is better in all{analogue}.", d.beside),
        )
        lines += ["", f"### {d.ours} against {d.baseline}, {where}", ""]
        for text, comparisons in tables:
            lines += [text, "", *to_markdown(comparison_table(comparisons, d.baseline, d.ours)), ""]
    return lines


def latex(found: Sequence[Duel]) -> list[str]:
    """The five metrics of every duel over all frames, as LaTeX."""
    lines: list[str] = []
    for d in found:
        lines += [f"% {d.ours} against {d.baseline}, {d.kind}, {d.clips} clips, all frames"]
        lines += [*to_latex(comparison_table(d.all_frames, d.baseline, d.ours)), ""]
    return lines


def to_csv(found: Sequence[Duel]) -> str:
    """One line for each duel, choice of frames and metric."""
    lines: list[Sequence[Any]] = [CSV_HEADER]
    for d in found:
        of_choices = zip(CHOICES, (d.all_frames, d.sound_frames, d.sound_clips, d.beside))
        for frames, comparisons in of_choices:
            for c in comparisons:
                means = [v for e in (c.baseline, c.ours, c.difference) for v in (e.mean, e.low, e.high)]
                tests = ["" if math.isnan(v) else v for v in (c.wins, c.p, c.p_holm)]
                lines += [[d.baseline, d.ours, d.kind, frames, c.name, c.unit, *means, c.difference.count, *tests]]
    return csv_text(lines)


def write_table1(rows: Sequence[Row], found: Sequence[Duel], folder: Path, out: Path | None, command: str) -> None:
    """Write table1.md, table1.csv and table1.tex into ``folder``; ``out`` has its section rewritten."""
    smoke = " Budgets are cut: this tier compares nothing." if any(row["options"] for row in rows) else ""
    lines = [
        f"Made by `{command}`; protocol: docs/protocol.md.{smoke}",
        "Differences are ours minus the baseline's, clip by clip, with 95 % bootstrap intervals; bold ones exclude 0",
        f"and have p, by Holm where it is given, at most {LEVEL} (of {FEWEST} clips or more that differ).",
        measured_at(rows),
        *machine(rows),
        *markdown(found),
    ]
    write_text(folder / "table1.md", "\n".join(lines).rstrip() + "\n")
    write_text(folder / "table1.csv", to_csv(found))
    write_text(folder / "table1.tex", "\n".join(latex(found)))
    if out is not None:
        write_section(out, SECTIONS["table1"], lines)
