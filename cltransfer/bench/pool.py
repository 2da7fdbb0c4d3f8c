"""Runs of the driver bench put together: what the clips of their CSVs come to, each against the paper's setting.

The CSV is the one that :func:`.driver_chart.write_driver_chart` writes; an empty cell is what was not measured.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path

from ..config import presets
from ..errors import InputError
from ..report.svg import SMALL, svg
from ..storage.files import read_text, write_text
from ..study.intervals import exact_interval
from .driver import PAPER, Clip
from .driver_chart import COLUMNS
from .driver_table import HEADER, Pair, against, comparable, met, summary
from .pages import SECTIONS
from .pool_chart import draw
from .section import table, write_section

LIMIT = 2**24  # bytes, of a CSV


def read_clips(path: Path) -> list[Clip]:
    """Clips of a CSV.

    Raises:
        InputError: it is no such CSV, or has none.
    """
    lines = csv.DictReader(io.StringIO(read_text(path, LIMIT)), strict=True)
    try:
        if tuple(lines.fieldnames or ()) != COLUMNS:
            raise InputError(path, "line 1", f"expected the columns {', '.join(COLUMNS)}", "see `bench driver`")
        clips = [_clip(row, path, lines.line_num) for row in lines]
    except csv.Error as error:
        raise InputError(path, f"line {lines.line_num}", f"expected CSV, {error}") from None
    if not clips:
        raise InputError(path, "", "expected clips, has none")
    return clips


def read_together(paths: Sequence[Path]) -> list[Clip]:
    """Clips of several CSVs.

    Raises:
        InputError: one is no such CSV, or has a clip that stood before, there or in another.
    """
    found: dict[tuple[str, str, str, int], Clip] = {}
    for path in paths:
        for clip in read_clips(path):
            name = (clip.preset, clip.target, clip.shot, clip.seed)
            if name in found:
                raise InputError(path, " ".join(map(str, name)), "stands twice", "name each clip once")
            found[name] = clip
    return list(found.values())


def _clip(row: dict[str, str], path: Path, line: int) -> Clip:
    if None in row or None in row.values():
        raise InputError(path, f"line {line}", f"expected {len(COLUMNS)} values")
    try:
        numbers = [float(row[name] or "nan") for name in COLUMNS[4:]]
        clip = Clip(row["preset"], row["target"], row["shot"], int(row["seed"]), *numbers)
    except ValueError as error:
        raise InputError(path, f"line {line}", f"expected numbers behind the names, {error}") from None
    if not math.isfinite(clip.total + clip.evaluations + clip.seconds) or any(map(math.isinf, numbers)):
        raise InputError(path, f"line {line}", "expected a total, evaluations and seconds, and no infinite number")
    if clip.preset not in presets():
        raise InputError(path, f"line {line}", f"expected a preset, got {clip.preset!r}", ", ".join(presets()))
    return clip


def by_shot(clips: Sequence[Clip]) -> tuple[list[str], list[list[str]]]:
    """Header and rows of a table: one row a shot and one of all, each preset across scenes against the paper's setting.

    Shots that the paper's setting never ran are left out.
    """
    presets = [name for name in dict.fromkeys(clip.preset for clip in clips) if name != PAPER]
    pairs = {name: met(name, "cross", clips) for name in presets}
    same = {name: comparable(name) for name in presets}
    header = ["shot", "clips of the paper's", "their mean"]
    for name in presets:
        header += [f"{name}: at or below", "share of paper's mean", "judged at or below", "evaluations a frame"]
    theirs = {(c.shot, c.seed): c for c in clips if (c.preset, c.target) == (PAPER, "cross")}
    rows = []
    for shot in [*dict.fromkeys(shot for shot, _ in theirs), None]:
        rivals = [clip.total for clip in theirs.values() if shot in (None, clip.shot)]
        row = [shot or "all", str(len(rivals)), f"{math.fsum(rivals) / len(rivals):.3f}" if rivals else ""]
        for name in presets:
            shown = [pair for pair in pairs[name] if shot in (None, pair[0].shot)]
            row += _held(shown, same[name], interval=shot is None)
        rows.append(row)
    return header, rows


def _held(pairs: Sequence[Pair], same: bool, interval: bool) -> list[str]:
    """At or below, share, judged at or below and evaluations, of clips of ours and the paper's.

    Totals are held against each other where they are of the ``same`` losses.
    """
    share = [(c.total, p.total) for c, p in pairs] if same else []
    judged = [(c.judged, p.judged) for c, p in pairs]
    (beaten, part), (seen, _) = against(share), against(judged)
    if interval:
        beaten, seen = beaten + _span(share), seen + _span(judged)
    spent = f"{math.fsum(c.evaluations for c, _ in pairs) / len(pairs):.1f}" if pairs else ""
    return [beaten, part, seen, spent]


def _span(pairs: Sequence[tuple[float, float]]) -> str:
    """The share that is at or below, with its exact 95 % interval; empty where no pair is known."""
    known = [own <= other for own, other in pairs if not math.isnan(own + other)]
    if not known:
        return ""
    low, high = exact_interval(sum(known), len(known))
    return f": {sum(known) / len(known):.1%} [{low:.1%}, {high:.1%}]".replace("%", " %")


def report_lines(clips: Sequence[Clip]) -> list[str]:
    """Both tables in Markdown."""
    return [*table(HEADER, summary(clips)), "", *table(*by_shot(clips))]


def write_pool(clips: Sequence[Clip], path: Path, command: str) -> None:
    """Rewrite the section "Runs together" of the Markdown file ``path``, and ``pool.svg`` beside it."""
    lines = [
        f"Made by `{command}` of clips that were measured before. Columns are those of `bench driver`; what a run did",
        "not measure is left out: judged values are those of the clips that have one. Intervals are exact, of 95 %.",
        "",
        *report_lines(clips),
        "",
        "![Total of each clip, over that of the paper's setting](pool.svg)",
    ]
    write_section(path, SECTIONS["pool"], lines)
    write_text(path.parent / "pool.svg", svg(lambda figure: draw(figure, clips), (9.0, 4.6), SMALL))
