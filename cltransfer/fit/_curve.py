"""What each level of detail reached: the curve that says how much a scene needs."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..report.svg import svg
from ..storage.files import write_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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


def write_curve(folder: Path, levels: Sequence[Level]) -> None:
    """Write curve.csv, a row a level, and curve.svg, held-out PSNR against cells."""
    table = io.StringIO()
    rows = csv.DictWriter(table, list(Level.__dataclass_fields__), lineterminator="\n")
    rows.writeheader()
    rows.writerows(asdict(level) for level in levels)
    write_text(folder / "curve.csv", table.getvalue())
    write_text(folder / "curve.svg", svg(lambda figure: _draw(figure, levels), (5, 3.2), {}))


def _draw(figure: Figure, levels: Sequence[Level]) -> None:
    axes = figure.subplots()
    axes.semilogx([v.cells for v in levels], [v.psnr for v in levels], color="0.2", marker="o", mfc="white")
    kept = [v for v in levels if v.kept]
    axes.plot([v.cells for v in kept], [v.psnr for v in kept], "o", color="0.2", label="kept")
    for level in levels:
        note = f"{level.psnr:.1f} dB\n{level.seconds:.0f} s"
        axes.annotate(note, (level.cells, level.psnr), (6, -20), textcoords="offset points", fontsize=7)
    axes.set_xticks([v.cells for v in levels], [f"{v.cells:,}" for v in levels], fontsize=8)
    axes.minorticks_off()
    axes.set(xlabel="cells", ylabel="held-out PSNR [dB]")
    axes.margins(x=0.15, y=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, loc="upper left")
