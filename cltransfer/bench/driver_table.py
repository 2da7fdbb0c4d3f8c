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

FOUND = (0.006, 0.1, 0.005)  # subject heights (1 cm of 1.64 m), degrees, share: medians over the frames of a clip
Pair = tuple[Clip, Clip]  # ours, and the paper's of the same shot
HEADER = (
    "preset", "target", "clips", "total, mean", "median", "worst", "at or below paper", "share of paper's mean",
    "judged, mean", "judged at or below", "judged share", "evaluations a frame", "seconds a clip", "position [heights]",
    "rotation [deg]", "focal [%]", "camera found", "cost of the path", "jerk before / after / of the reference",
)  # fmt: skip


def summary(clips: Sequence[Clip]) -> list[list[str]]:
    """One row for each preset and target, under :data:`HEADER`."""
    rows = []
    for preset, target in dict.fromkeys((c.preset, c.target) for c in clips):
        mine = [c for c in clips if (c.preset, c.target) == (preset, target)]
        pairs = met(preset, target, clips)
        held = [(c.total, rival.total) for c, rival in pairs] if pairs and comparable(preset) else []
        totals = [c.total for c in mine]
        posed = [c for c in mine if not math.isnan(c.position + c.rotation + c.focal)]
        poses = [[c.position for c in posed], [c.rotation for c in posed], [100 * abs(c.focal) for c in posed]]
        rows.append(
            [preset, target, str(len(mine)), f"{fmean(totals):.3f}", f"{median(totals):.3f}", f"{max(totals):.3f}"]
            + against(held)
            + [_mean([c.judged for c in mine])]
            + against([(c.judged, rival.judged) for c, rival in pairs])
            + [f"{fmean(c.evaluations for c in mine):.1f}"]
            + [f"{median(c.seconds for c in mine):.2f}"]
            + [f"{median(values):.4f}" if posed else "" for values in poses]
            + [f"{sum(map(found, posed))} of {len(posed)}" if posed else ""]
            + [f"{fmean(c.extra for c in mine):+.3f}"]
            + [" / ".join(_mean([getattr(c, name) for c in mine], "–", 4) for name in ("shaken", "smooth", "true"))]
        )
    return rows


def found(clip: Clip) -> bool:
    """Whether the camera of a clip taught to its own scene is the true one, within :data:`FOUND`."""
    return all(abs(error) <= most for error, most in zip((clip.position, clip.rotation, clip.focal), FOUND))


def comparable(preset: str) -> bool:
    """Whether totals of ``preset`` mean what the paper's do: the losses are the same, their modes and weights too."""
    ours, papers = (settings(name, 0).build("losses") for name in (preset, PAPER))
    return bool(ours == papers)


def met(preset: str, target: str, clips: Sequence[Clip]) -> list[Pair]:
    """Clips of ``preset`` on ``target``, each with that of the paper's setting; those that it did not run are left out.

    The paper's setting itself meets nothing.
    """
    paper = {(c.shot, c.seed): c for c in clips if (c.preset, c.target) == (PAPER, target)}
    mine = [c for c in clips if (c.preset, c.target) == (preset, target) and preset != PAPER]
    return [(c, paper[name]) for c in mine if (name := (c.shot, c.seed)) in paper]


def _mean(values: Sequence[float], unknown: str = "", digits: int = 3) -> str:
    """Mean of the values that are known: a clip of fewer than four frames has no jerk, one of an older run no judge."""
    known = [value for value in values if not math.isnan(value)]
    return f"{fmean(known):.{digits}f}" if known else unknown


def against(pairs: Sequence[tuple[float, float]]) -> list[str]:
    """On how many clips ours is at or below the paper's, and its mean as a share of theirs; of pairs known on both."""
    known = [(own, other) for own, other in pairs if not math.isnan(own + other)]
    if not known:
        return ["", ""]
    ours, theirs = zip(*known)
    beaten = sum(own <= other for own, other in known)
    return [f"{beaten} of {len(known)}", f"{fmean(ours) / fmean(theirs):.2f}" if fmean(theirs) else ""]


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
        "Camera found: clips whose median errors are at most {} heights (1 cm), {} degrees and {:.1%}.".format(*FOUND),
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
