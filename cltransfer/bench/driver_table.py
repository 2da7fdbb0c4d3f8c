"""The table of the driver bench: one row for each preset and target, and the section that holds it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean, median

from .driver import PAPER, Clip, clips_of, settings
from .driver_chart import write_driver_chart
from .judge import SIDE
from .pages import SECTIONS
from .rows import measured_at
from .section import machine, table, write_section
from .trial import Row

HEADER = (
    "preset", "target", "clips", "total, mean", "median", "worst", "at or below paper", "share of paper's mean",
    "judged, mean", "judged at or below", "judged share", "evaluations a frame", "seconds a clip", "position [heights]",
    "rotation [deg]", "focal [%]", "cost of the path", "jerk before / after / of the reference",
)  # fmt: skip


def summary(clips: Sequence[Clip]) -> list[list[str]]:
    """One row for each preset and target, under :data:`HEADER`."""
    paper = {(c.target, c.shot, c.seed): c for c in clips if c.preset == PAPER}
    rows = []
    for preset, target in dict.fromkeys((c.preset, c.target) for c in clips):
        mine = [c for c in clips if (c.preset, c.target) == (preset, target)]
        met = [] if preset == PAPER else [(c, paper[name]) for c in mine if (name := (target, c.shot, c.seed)) in paper]
        alike = settings(preset, 0).losses.keys() == settings(PAPER, 0).losses.keys()  # else totals mean other things
        totals = [c.total for c in mine]
        poses = [[c.position for c in mine], [c.rotation for c in mine], [100 * c.focal for c in mine]]
        rows.append(
            [preset, target, str(len(mine)), f"{fmean(totals):.3f}", f"{median(totals):.3f}", f"{max(totals):.3f}"]
            + _against([(c.total, rival.total) for c, rival in met if alike])
            + [f"{fmean(c.judged for c in mine):.3f}"]
            + _against([(c.judged, rival.judged) for c, rival in met])
            + [f"{fmean(c.evaluations for c in mine):.1f}"]
            + [f"{median(c.seconds for c in mine):.2f}"]
            + ["" if math.isnan(values[0]) else f"{median(values):.4f}" for values in poses]
            + [f"{fmean(c.extra for c in mine):+.3f}"]
            + [" / ".join(_jerk([getattr(c, name) for c in mine]) for name in ("shaken", "smooth", "true"))]
        )
    return rows


def _jerk(values: Sequence[float]) -> str:
    """Their mean; a clip of fewer than four frames has none."""
    return "–" if math.isnan(fmean(values)) else f"{fmean(values):.4f}"


def _against(pairs: Sequence[tuple[float, float]]) -> list[str]:
    """On how many clips ours is at or below the paper's, of ``pairs`` of both, and its mean as a share of theirs."""
    if not pairs:
        return ["", ""]
    ours, theirs = zip(*pairs)
    beaten = sum(own <= other for own, other in pairs)
    return [f"{beaten} of {len(pairs)}", f"{fmean(ours) / fmean(theirs):.2f}"]


def write_driver(rows: Sequence[Row], path: Path, command: str) -> None:
    """Rewrite the section "The driver" of the Markdown file ``path``."""
    clips = clips_of(rows)
    lines = [
        f"Made by `{command}`. Canonical shots in the plaza, taught to the plaza (self: true cameras known) and to the",
        "courtyard (cross); a total of 1 means every term at its tolerance, in the scene as it is, with the floaters",
        "that a search may leave out. Means over clips, but for seconds and pose errors: medians over clips, of the",
        "median over frames. Paper: its parameters, ranges, steps and full budget on the same geometric features and",
        "robust losses. Total: by the search's own losses at its own size, 160 px. Judged: by the judge of protocol.md",
        f"at {SIDE} px, a size that nobody searches at, so that what was gained by single pixels does not count.",
        "Jerk: of the frames as they were found, of the path taken, of the reference. Cost of the path: its",
        "total less that of the frames.",
        *machine(rows),
        measured_at(rows),
        "",
        *table(HEADER, summary(clips)),
        "",
        "![Loss against evaluations and seconds](driver.svg)",
    ]
    write_section(path, SECTIONS["driver"], lines)
    write_driver_chart(clips, path.parent)
