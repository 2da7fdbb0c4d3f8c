"""The chart as SVG, and its section of docs/benchmarks.md; the same points give the same bytes."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..report.metrics import number as written
from ..report.svg import SMALL, svg
from ..report.tables import Table, to_markdown
from ..storage.files import write_text
from .chart import TARGETS, Hits, Point, Setting, hit_curves, hits_csv, pareto, points, points_csv
from .pages import SECTIONS
from .rows import measured_at
from .section import machine, write_section
from .trial import Row

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COSTS = {"evaluations": "evaluations a frame", "seconds": "seconds a clip"}
LETTER, LINE = 0.0155, 0.04  # width and height of a letter of a point's name [of the axes]
SIDES = (  # which end of a name is at its point, and how high [pt], [of its lines]
    ("left", 4, 0.8),
    ("center", -14, -1.6),
    ("left", -9, -0.8),
    ("right", 4, 0.8),
    ("right", -9, -0.8),
    ("center", 8, 1.4),
)
_INK, _FRONT = "#333333", "#999999"
_COLORS = ("#3b6fb6", "#d1603d", "#4f9d69", "#8a63a8", "#b58a2c", "#5aa5b8", "#c25b8b", "#6b6b6b")
_MARKERS = "osD^vP*X"


def write_chart(rows: Sequence[Row], settings: Sequence[Setting], folder: Path, out: Path | None, command: str) -> None:
    """Write chart.svg, hits.svg, chart.csv and hits.csv; ``out`` has its section rewritten, the charts beside it."""
    found, curves = points(settings, rows), hit_curves(rows)
    places = [folder] if out is None else [folder, out.parent]
    for place in places:
        write_text(place / "chart.svg", svg(lambda figure: _draw_points(figure, found), (9.0, 7.4), SMALL))
        write_text(place / "hits.svg", svg(lambda figure: _draw_hits(figure, curves), (9.0, 3.2), SMALL))
        write_text(place / "chart.csv", points_csv(found))
        write_text(place / "hits.csv", hits_csv(curves))
    if out is not None:
        lines = [
            f"Made by `{command}`; protocol: docs/protocol.md. Means over the same clips; a total of 1 means every",
            "term at its tolerance. A line joins settings that differ in one budget; the grey steps are the Pareto",
            "front. In rows of CMA-ES it takes the place of least squares in every frame; their paths are smoothed",
            "and refined as those of `balanced` are.",
            *machine(rows),
            measured_at(rows),
            "",
            "![Loss and success against evaluations and seconds](chart.svg)",
            "",
            "![Share of clips at or below a total, against evaluations](hits.svg)",
            "",
            *to_markdown(_table(found)),
        ]
        write_section(out, SECTIONS["chart"], lines)


def _table(found: Sequence[Point]) -> Table:
    header = ("setting", "family", "clips", "evaluations a frame", "seconds a clip", "total, mean", "median", "success")
    cells = [
        (p.label, p.family, str(p.clips), *map(written, costs), f"{100 * p.success:.0f} %")
        for p in found
        for costs in [(p.evaluations, p.seconds, p.total, p.median_total)]
    ]
    return Table(header, tuple(cells))


def _draw_points(figure: Figure, found: Sequence[Point]) -> None:
    axes = figure.subplots(2, 2, sharex="col")
    families = list(dict.fromkeys(p.family for p in found))
    for column, cost in enumerate(COSTS):
        _losses(axes[0, column], found, families, cost)
        _successes(axes[1, column], found, families, cost)
        axes[1, column].set_xlabel(COSTS[cost])
    axes[0, 0].set_title("mean total (1: every term at its tolerance)", loc="left", fontsize=9)
    axes[1, 0].set_title("share of clips that do not fail [%]", loc="left", fontsize=9)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncol=5, frameon=False)


def _losses(ax: Axes, found: Sequence[Point], families: Sequence[str], cost: str) -> None:
    front = pareto([getattr(p, cost) for p in found], [p.total for p in found])
    steps = [(getattr(found[i], cost), found[i].total) for i in front]
    ax.step(*zip(*steps), where="post", color=_FRONT, linewidth=4, alpha=0.4, label="Pareto front")
    _families(ax, found, families, cost, "total")
    ax.set_yscale("log")
    ticks = _round_steps([p.total for p in found])
    ax.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    ax.set_ylim(0.7 * ticks[0], ticks[-1])
    ring: Any = {"marker": "o", "markersize": 10, "fillstyle": "none", "color": _INK, "linestyle": ""}
    ax.plot(*zip(*steps), **ring, label="on the front")
    _finish(ax, [getattr(p, cost) for p in found])
    _names(ax, found, families, cost)


def _names(ax: Axes, found: Sequence[Point], families: Sequence[str], cost: str) -> None:
    """The points' names, presets first, on the first side that is free; where none is, only the table has it.

    Of settings that are one point the first names it.
    """
    places = [(getattr(p, cost), p.total) for p in found]
    inside = ax.transAxes.inverted().transform(ax.transData.transform(places))  # (P, 2) [of the axes]
    taken = [(x - LETTER / 2, x + LETTER / 2, y) for x, y in inside]  # left, right, middle; no name lies on a point
    for i, (p, place, (x, y)) in enumerate(zip(found, places, inside)):
        width = LETTER * len(p.label)
        ends = {"left": x + LETTER / 2, "center": x - width / 2, "right": x - width - LETTER / 2}
        for end, height, lines in SIDES if place not in places[:i] else ():
            left, right, middle = ends[end], ends[end] + width, y + lines * LINE
            if any(left < stop and right > begin and abs(middle - at) < 0.75 * LINE for begin, stop, at in taken):
                continue
            taken.append((left, right, middle))
            color = _COLORS[families.index(p.family) % len(_COLORS)]
            offset = ({"left": 5, "center": 0, "right": -5}[end], height)
            style: Any = {"textcoords": "offset points", "ha": end, "fontsize": 6.5, "color": color}
            ax.annotate(p.label, place, offset, **style)
            break


def _successes(ax: Axes, found: Sequence[Point], families: Sequence[str], cost: str) -> None:
    _families(ax, found, families, cost, "success")
    ax.set_ylim(-0.04, 1.08)
    ax.yaxis.set_major_formatter(lambda value, _: f"{100 * value:.0f}")
    _finish(ax, [getattr(p, cost) for p in found])


def _families(ax: Axes, found: Sequence[Point], families: Sequence[str], cost: str, value: str) -> None:
    for number, family in enumerate(families):
        own = sorted((p for p in found if p.family == family), key=lambda p: getattr(p, cost))
        joined = family not in ("presets", "baselines")
        place = ([getattr(p, cost) for p in own], [getattr(p, value) for p in own])
        color, marker = _COLORS[number % len(_COLORS)], _MARKERS[number % len(_MARKERS)]
        line = "-" if joined else ""
        ax.plot(*place, linestyle=line, linewidth=0.7, color=color, marker=marker, markersize=5, label=family)


def _finish(ax: Axes, costs: Sequence[float]) -> None:
    ax.set_xscale("log")
    ticks = _round_steps(costs)
    ax.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    ax.set_xlim(ticks[0], ticks[-1])
    ax.minorticks_off()
    ax.grid(linewidth=0.3)
    ax.spines[["top", "right"]].set_visible(False)


def _round_steps(values: Sequence[float]) -> list[float]:
    """The 1, 2 and 5 of every power of ten around positive values, one beyond them at either end.

    >>> _round_steps([3.0, 40.0])
    [2.0, 5.0, 10.0, 20.0, 50.0]
    """
    steps = [float(f"{a}e{n}") for n in range(-6, 9) for a in (1, 2, 5)]
    low, high = min(values) / 1.15, max(values) * 1.15
    return [s for s, after, before in zip(steps, [*steps[1:], inf], [0.0, *steps]) if after > low and before < high]


def _draw_hits(figure: Figure, curves: Sequence[Hits]) -> None:
    axes = figure.subplots(1, len(TARGETS), sharey=True)
    families = list(dict.fromkeys(c.family for c in curves))
    for ax, target in zip(axes, TARGETS):
        for curve in (c for c in curves if c.target == target):
            color = _COLORS[families.index(curve.family) % len(_COLORS)]
            x, y = (curve.least, *curve.evaluations, curve.most), (0.0, *curve.share)
            ax.step(x, (*y, y[-1]), where="post", color=color, label=curve.family)
        ax.set_title(f"share of clips with a total of {target:g} or less [%]", loc="left", fontsize=8)
        ax.set_ylim(-0.04, 1.04)
        ax.yaxis.set_major_formatter(lambda value, _: f"{100 * value:.0f}")
        ax.set_xlabel("evaluations a frame")
        _finish(ax, [e for c in curves for e in (c.least, c.most)])
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncol=5, frameon=False)
