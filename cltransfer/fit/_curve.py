"""What each level of detail reached: the curve that says how much a scene needs."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..report.svg import svg
from ..storage.files import write_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROOM = 0.25  # of the way from the fewest cells to the most: as long as a number below the axis
NOTES = (((6, -20), "left"), ((-6, 8), "right"))  # where a note of each row stands [pt], and which side of it there


@dataclass(frozen=True)
class Level:
    """A fit at one level of detail.

    Args:
        cells: of the model, or Gaussians.
        filled: of them that hold matter.
        psnr: mean over the held-out views [dB].
        steps: of gradient descent at this level.
        seconds: that they took.
        kept: whether the level gained enough over the one before.
    """

    cells: int
    filled: int
    psnr: float  # [dB]
    steps: int
    seconds: float
    kept: bool


def write_curve(folder: Path, levels: Sequence[Level], counted: str) -> None:
    """Write curve.csv, a row a level, and curve.svg, held-out PSNR against size: how many of what is ``counted``."""
    table = io.StringIO()
    rows = csv.DictWriter(table, list(Level.__dataclass_fields__), lineterminator="\n")
    rows.writeheader()
    rows.writerows(asdict(level) for level in levels)
    write_text(folder / "curve.csv", table.getvalue())
    write_text(folder / "curve.svg", svg(lambda figure: _draw(figure, levels, counted), (5, 3.2), {}))


def _draw(figure: Figure, levels: Sequence[Level], counted: str) -> None:
    axes = figure.subplots()
    axes.semilogx([v.cells for v in levels], [v.psnr for v in levels], color="0.2", marker="o", mfc="white")
    kept = [v for v in levels if v.kept]
    axes.plot([v.cells for v in kept], [v.psnr for v in kept], "o", color="0.2", label="kept")
    rows = _rows(levels)
    for level, row in zip(levels, rows):
        if row is not None:
            note, place, side = f"{level.psnr:.1f} dB\n{level.seconds:.0f} s", *NOTES[row]
            at = (level.cells, level.psnr)
            axes.annotate(note, at, place, textcoords="offset points", fontsize=7, ha=side)
    told = ["" if row is None else "\n" * row + f"{v.cells:,}" for v, row in zip(levels, rows)]
    axes.set_xticks([v.cells for v in levels], told, fontsize=8)
    axes.minorticks_off()
    axes.set(xlabel=counted, ylabel="held-out PSNR [dB]")
    axes.margins(x=0.15, y=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, loc="upper left")


def _rows(levels: Sequence[Level]) -> list[int | None]:
    """In which row each level is told of, where levels are near one another: the last that was kept chooses first.

    None has room for neither; curve.csv tells of all.
    """
    places = [math.log(level.cells) for level in levels]
    room = ROOM * (max(places) - min(places))
    rows: list[int | None] = [None] * len(levels)
    for i in sorted(range(len(levels)), key=lambda i: (levels[i].kept, i), reverse=True):
        beside = {row for row, place in zip(rows, places) if abs(place - places[i]) < room}
        rows[i] = next((row for row in range(len(NOTES)) if row not in beside), None)
    return rows
