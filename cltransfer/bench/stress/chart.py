"""Success, and the mean total, against level; one small chart a stressor, one line a method."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...report.svg import SMALL, svg
from ...storage.files import write_text
from .trial import STRESSORS
from .verdicts import StressVerdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMNS = 4
MARKERS = "os^Dv<>P"
SPREAD = 0.3  # of a level: how far the marks of the first and of the last method stand apart


def write_success(found: Sequence[StressVerdict], path: Path) -> None:
    """Draw the share of clips that did not fail as SVG; the same verdicts give the same bytes."""
    _write(found, path, "clips that did not fail", _success)


def _success(ax: Any, verdict: StressVerdict, beside: float, style: Mapping[str, Any]) -> None:
    """Lines on one another are all seen: each is thinner than the one below it, its marks stand beside the level."""
    at = [level + SPREAD * beside for level in range(len(verdict.success))]
    ax.plot(at, verdict.success, linewidth=2 - 2 * beside, **style)
    ax.set_ylim(-0.07, 1.07)
    ax.axhline(0.5, linewidth=0.5, color="0.5", linestyle=":")


def write_totals(found: Sequence[StressVerdict], path: Path) -> None:
    """Draw the mean totals as SVG; the same verdicts give the same bytes."""
    from ..plain_axis import plain

    def draw(ax: Any, verdict: StressVerdict, beside: float, style: Mapping[str, Any]) -> None:
        ax.plot(verdict.totals, **style)
        ax.set_yscale("log")
        plain(ax.yaxis)

    _write(found, path, "mean total", draw)


Draw = Callable[[Any, StressVerdict, float, Mapping[str, Any]], None]  # the number: from -0.5, the first method, to 0.5


def _write(found: Sequence[StressVerdict], path: Path, label: str, draw: Draw) -> None:
    stressors = list(dict.fromkeys(verdict.stressor for verdict in found))
    methods = list(dict.fromkeys(verdict.method for verdict in found))
    columns = min(COLUMNS, len(stressors))
    rows = math.ceil(len(stressors) / columns)
    middle = (len(methods) - 1) / 2

    def draw_all(figure: Figure) -> None:
        axes = figure.subplots(rows, columns, squeeze=False, sharey=True)
        for ax in axes.flat[len(stressors) :]:
            ax.set_visible(False)
        for ax, stressor in zip(axes.flat, stressors):
            for verdict in (v for v in found if v.stressor == stressor):
                i = methods.index(verdict.method)
                style = {
                    "marker": MARKERS[i % len(MARKERS)],
                    "markersize": 4,
                    "color": f"C{i}",
                    "label": verdict.method,
                }
                draw(ax, verdict, (i - middle) / max(1, 2 * middle), style)
            levels = ["none", *(f"{value:g}" for value in STRESSORS[stressor].levels)]
            ax.set_xticks(range(len(levels)), levels, fontsize=7)
            ax.set_title(stressor.replace("_", " "), loc="left", fontsize=9)
            ax.set_xlabel(STRESSORS[stressor].unit, fontsize=7)
            ax.spines[["top", "right"]].set_visible(False)
        for ax in axes[:, 0]:
            ax.set_ylabel(label)
        handles, labels = axes.flat[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper left", ncols=len(methods), frameon=False)

    write_text(path, svg(draw_all, (2.6 * columns, 0.5 + 2.2 * rows), SMALL))
