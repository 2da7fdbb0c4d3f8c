"""The chart of the driver bench: what each preset's clips cost, and what they reach."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING

from ..report.svg import SMALL, svg
from ..storage.files import csv_text, write_text
from .driver import Clip, row_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLORS = ("#4477aa", "#ee6677", "#228833", "#aa3377", "#ccbb44", "#66ccee", "#bbbbbb")
COSTS = (("evaluations", "evaluations a frame"), ("seconds", "seconds a clip, search"))
COLUMNS = tuple(field.name for field in fields(Clip))
LOWEST = 1e-3  # total below which nobody cares


def write_driver_chart(clips: Sequence[Clip], folder: Path) -> None:
    """Write ``driver.svg`` and ``driver.csv``, one row a clip, into ``folder``."""
    write_text(folder / "driver.csv", driver_csv(clips))
    write_text(folder / "driver.svg", svg(lambda figure: _draw(figure, clips), (9.0, 6.4), SMALL))


def driver_csv(clips: Sequence[Clip]) -> str:
    """One line a clip; a cell is empty for NaN, which a jerk of fewer than four frames is."""
    return csv_text([COLUMNS, *(row_of(clip).values() for clip in clips)], 6)


def _draw(figure: Figure, clips: Sequence[Clip]) -> None:
    targets = list(dict.fromkeys(clip.target for clip in clips))
    colors = dict(zip(dict.fromkeys(clip.preset for clip in clips), cycle(COLORS)))
    grid = figure.subplots(len(targets), len(COSTS), sharey="row", squeeze=False)
    for row, target in zip(grid, targets):
        mine = [clip for clip in clips if clip.target == target]
        for ax, (cost, label) in zip(row, COSTS):
            _panel(ax, mine, cost, colors)
            ax.set_xlabel(label)
        row[0].set_ylabel(f"{target}: mean total of a clip{floored(clip.total for clip in mine)}")
    shown = {label: dot for ax in grid[:, 0] for dot, label in zip(*ax.get_legend_handles_labels())}
    grid[0][0].legend(list(shown.values()), list(shown), frameon=False, fontsize=8)


def floored(totals: Iterable[float]) -> str:
    """What is said where some of ``totals`` are drawn at :data:`LOWEST` and lie below it; else empty."""
    return f" (below {LOWEST:g} at {LOWEST:g})" if min(totals, default=LOWEST) < LOWEST else ""


def _panel(ax: Axes, clips: Sequence[Clip], cost: str, colors: Mapping[str, str]) -> None:
    """Each clip a dot, each preset's median a ring."""
    from statistics import median

    from .plain_axis import plain

    for preset in dict.fromkeys(clip.preset for clip in clips):
        color = colors[preset]
        mine = [clip for clip in clips if clip.preset == preset]
        x, y = [getattr(clip, cost) for clip in mine], [max(clip.total, LOWEST) for clip in mine]
        ax.scatter(x, y, 9, color=color, alpha=0.45, linewidths=0, label=preset)
        ax.scatter([median(x)], [median(y)], 90, facecolors="none", edgecolors=color, linewidths=2)
    ax.set_xscale("log")
    ax.set_yscale("log")
    plain(ax.xaxis)
    plain(ax.yaxis)
    ax.axhline(1.0, color="#999999", linewidth=0.8, linestyle=":")
    ax.grid(alpha=0.25)
