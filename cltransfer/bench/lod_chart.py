"""The chart and the table of ``cltransfer bench lod``: what a level of detail costs, over what it gains."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..report.svg import SMALL, svg
from ..storage.files import write_text
from .lod import LodRow, write_csv
from .pages import SECTIONS
from .section import machine, table, write_section

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PANELS = (
    ("psnr", "PSNR to the full scene [dB]"),
    ("depth_median", "median depth error [%]"),
    ("mask_area", "mask area over the full scene's"),
    ("middle", "Spearman of candidates, composition"),
)

HEADER = (
    *("scene", "k", "Gaussians", "merged in", "ms a frame", "faster", "PSNR", "depth error, median and 95 %"),
    *("mask area", "rank early", "middle", "late", "by image", "by depth"),
)


def write_lod(rows: Sequence[LodRow], folder: Path, command: str) -> None:
    """Write lod.csv and lod.svg into ``folder``, and the table into its benchmarks.md."""
    write_csv(rows, folder / "lod.csv")
    write_chart(rows, folder / "lod.svg")
    lines = [
        f"Made by `{command}`. 160x90, all buffers, processor time on one",
        "thread, full and merged scene in turn. Rank: Spearman's correlation with the full scene's order of 32",
        "candidates by composition (subject's centroid and log area), spread over 0.15, 0.03 and 0.006 subject",
        "heights, two steps from what they are after; by image and by depth: the least of the three.",
        *machine(),
        "",
        "![What a level of detail costs, over what it gains](lod.svg)",
        "",
        *table(HEADER, [_cells(row) for row in rows]),
    ]
    write_section(folder / "benchmarks.md", SECTIONS["lod"], lines)


def _cells(row: LodRow) -> list[str]:
    ranks = (row.early, row.middle, row.late, row.photometric, row.depth)
    gain = [f"{row.build:.1f} s", f"{row.milliseconds:.1f}", f"{row.speedup:.1f}x"]
    loss = [f"{row.psnr:.1f} dB", f"{row.depth_median:.2f} %, {row.depth_p95:.1f} %", f"{row.mask_area:.3f}"]
    level = f"{row.k:g}" if row.k else "full"
    return [row.scene, level, f"{row.gaussians:,}", *gain, *loss, *(f"{rank:.3f}" for rank in ranks)]


def write_chart(rows: Sequence[LodRow], path: Path) -> None:
    """Draw the rows with k > 0 against their speed-up, one line a scene; the same rows give the same bytes."""

    def draw(figure: Figure) -> None:
        for ax, (name, title) in zip(figure.subplots(2, 2).flat, PANELS):
            for place, scene in enumerate(dict.fromkeys(row.scene for row in rows)):
                of_scene = [row for row in rows if row.scene == scene and row.k > 0]
                values = [getattr(row, name) for row in of_scene]
                (line,) = ax.plot([row.speedup for row in of_scene], values, marker="o", markersize=4, label=scene)
                beside = (4, 4) if place % 2 == 0 else (4, -10)  # scenes' labels on either side of their lines
                for row, value in zip(of_scene, values):
                    ax.annotate(f"{row.k:g}", (row.speedup, value), beside, textcoords="offset points",
                                color=line.get_color())  # fmt: skip
            ax.set_title(title, loc="left", fontsize=9)
            ax.set_xlabel("times faster than the full scene; numbers are k [px]")
            ax.spines[["top", "right"]].set_visible(False)
            ax.grid(linewidth=0.3)
            ax.margins(0.12)
            ax.set_xscale("log")
            ax.set_xticks([1, 2, 5, 10, 20], ["1", "2", "5", "10", "20"])
            ax.minorticks_off()
        figure.axes[0].legend(frameon=False)

    write_text(path, svg(draw, (8.0, 5.0), SMALL))
