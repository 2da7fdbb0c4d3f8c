"""Charts of a report as SVG to be set into a page; the same values give the same bytes.

Colours are written as CSS variables of the page, so one chart serves light and dark and paper.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from ..export.lens import FULL_FRAME, millimetres
from ..pipeline.scores import Term
from ..subject import Subject
from ..trajectory import Trajectory
from .data import ReportData
from .strip import evenly
from .svg import svg

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# stand-ins that matplotlib can draw -> what the page makes of them
_INK, _FAINT, _MAIN, _OTHER = "#010101", "#020202", "#030303", "#040404"
_VARIABLES = {_INK: "var(--ink)", _FAINT: "var(--faint)", _MAIN: "var(--main)", _OTHER: "var(--other)"}

_STYLE: Any = {
    "text.color": _INK,
    "axes.edgecolor": _FAINT,
    "axes.labelcolor": _INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "axes.labelsize": 8,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "xtick.color": _FAINT,
    "ytick.color": _FAINT,
    "xtick.labelcolor": _INK,
    "ytick.labelcolor": _INK,
    "grid.color": _FAINT,
    "grid.linewidth": 0.3,
    "lines.linewidth": 1.6,
    "legend.frameon": False,
    "legend.fontsize": 8,
}

_MARGIN = 0.05  # beside the first and the last frame, of the time between them; [s] beside one alone
_TICKS = 5  # of an axis, at the most
_LOG_SPAN = 30.0  # largest over smallest value from which a chart is drawn on a log scale


def term_curves(report: ReportData) -> str:
    """Each raw term that has a value over time, with the first view held still beside it, (SVG)."""
    shown = [term for term in report.scores.terms if term.defined] or list(report.scores.terms)

    def draw(figure: Figure) -> None:
        axes = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
        for ax, term in zip(axes, shown):
            other = None if report.baseline is None else report.baseline.term(term.name)
            _curves(ax, report.times.numpy(), term, other, report.render_name)
        axes[0].legend(loc="lower right", bbox_to_anchor=(1, 1), ncol=2, borderpad=0)
        axes[-1].set_xlabel("time [s]")
        axes[-1].set_xlim(_limits(report.times.numpy()))

    told = f"each term over time: {', '.join(term.name for term in shown)}"
    return _svg(draw, (6.4, 1.15 * len(shown) + 0.3), told)


def _limits(times: np.ndarray) -> tuple[float, float]:
    """From where to where an axis of ``times`` (N,) [s] goes, whichever of them have a value."""
    beside = _MARGIN * (times[-1] - times[0]) or _MARGIN
    return times[0] - beside, times[-1] + beside


def _curves(ax: Axes, times: np.ndarray, term: Term, other: Term | None, name: str) -> None:
    series = [term.values.numpy()] + ([] if other is None else [other.values.numpy()])
    if len(series) == 2:
        ax.plot(
            times,
            series[1],
            color=_OTHER,
            linestyle=(0, (4, 2)),
            linewidth=1.1,
            label="first view held still",
        )
    ax.plot(times, series[0], color=_MAIN, label=name, marker="o", markersize=2)
    values = np.concatenate(series)
    positive = values[np.isfinite(values) & (values > 0)]
    scale = ""
    if len(positive) and positive.max() / positive.min() > _LOG_SPAN:
        scale = ", log scale"
        if (values <= 0).any():  # which has a place of its own, and is told from a gap
            scale += f" from {positive.min():.2g}"
            ax.set_yscale("symlog", linthresh=positive.min())
            ax.set_yticks(_decades(float(positive.min()), float(positive.max())))
        else:
            ax.set_yscale("log")
        ax.yaxis.set_minor_formatter(lambda value, _: "")
    else:
        ax.set_ylim(bottom=0)
    ax.yaxis.set_major_formatter(_plain)
    ax.set_title(f"{term.name} [{term.unit}]{scale}", pad=3)
    ax.grid(axis="y")


def _decades(low: float, high: float) -> list[float]:
    """0 and powers of ten up to ``high``, as many as can be read, on an axis that is even below ``low``, log above."""
    below = 10 / 9  # decades that 0 to ``low`` is as long as
    stride = math.ceil((below + math.log10(high / low)) / (_TICKS - 1))
    least = math.log10(low) + max(0.0, stride - below)
    return [0.0, *(10.0**power for power in range(math.floor(math.log10(high)), math.ceil(least) - 1, -stride))]


def _plain(value: float, _: float) -> str:
    """A tick as it is: a factor taken out of all of them would lie under the title."""
    return f"{value:g}"


def top_view(trajectory: Trajectory, subject: Subject) -> str:
    """The camera path from above, in subject heights, with the subject, its facing and some frusta, (SVG)."""
    camera = trajectory.camera
    ground = torch.stack([-subject.left, subject.facing]) / subject.height  # facing points up the page
    path = ((camera.center - subject.anchor) @ ground.T).numpy()
    corners = torch.tensor([[0.0, camera.size[1] / 2], [camera.size[0], camera.size[1] / 2]], dtype=torch.float64)
    depth = torch.full((len(camera), 2), 0.45 * subject.height, dtype=torch.float64)
    rays = camera.unproject(corners.expand(len(camera), 2, 2), depth)
    edges = ((rays - subject.anchor) @ ground.T).numpy()

    def draw(figure: Figure) -> None:
        ax = figure.subplots()
        for index in evenly(len(path), 7):
            triangle = np.stack([edges[index, 0], path[index], edges[index, 1]])
            ax.plot(*triangle.T, color=_OTHER, linewidth=0.9)
        ax.plot(*path.T, color=_MAIN)
        ax.plot(*path[0], marker="o", color=_MAIN, markersize=5)
        ax.annotate("start", path[0], xytext=(6, 4), textcoords="offset points", fontsize=8)
        ax.plot(0, 0, marker="o", color=_INK, markersize=7)
        ax.annotate("", (0, 0.6), (0, 0), arrowprops={"arrowstyle": "-|>", "color": _INK, "linewidth": 1.2})
        ax.annotate("subject faces", (0, 0), xytext=(8, -10), textcoords="offset points", fontsize=8)
        ax.set_aspect("equal", adjustable="datalim")
        ax.margins(0.12)
        ax.set_xlabel("from above [subject heights]")
        ax.grid()

    return _svg(draw, (4.4, 4.0), "the camera's path about the person, from above")


def lens_curves(trajectory: Trajectory, subject: Subject | None) -> str:
    """Focal length over time, and the distance to the subject where one is known, (SVG)."""
    times, camera = trajectory.times.numpy(), trajectory.camera
    rows = [(f"focal length [mm on a gate {FULL_FRAME:g} mm wide]", millimetres(camera).numpy())]
    if subject is not None:
        distance = (camera.center - subject.anchor).norm(dim=1) / subject.height
        rows.append(("distance [subject heights]", distance.numpy()))

    def draw(figure: Figure) -> None:
        axes = figure.subplots(len(rows), 1, sharex=True, squeeze=False)[:, 0]
        for ax, (name, values) in zip(axes, rows):
            ax.plot(times, values, color=_MAIN, marker="o", markersize=2)  # one frame alone is no line
            ax.set_ylim(0, 1.15 * float(values.max()))
            ax.yaxis.set_major_formatter(_plain)
            ax.set_title(name, pad=3)
            ax.grid(axis="y")
        axes[-1].set_xlabel("time [s]")

    return _svg(draw, (4.4, 1.25 * len(rows) + 0.3), f"{' and '.join(name for name, _ in rows)} over time")


def _svg(draw: Callable[[Figure], Any], size: tuple[float, float], told: str) -> str:
    """The ``<svg>`` element of a figure of ``size`` [inch]: no date, no links, colours as CSS variables.

    Who hears the page is ``told`` what it shows.
    """

    def draw_clear(figure: Figure) -> None:
        draw(figure)
        figure.patch.set_alpha(0)
        for ax in figure.axes:
            ax.patch.set_alpha(0)

    text = svg(draw_clear, size, _STYLE)
    text = re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
    text = re.sub(r'\sxmlns(:\w+)?="[^"]*"', "", text)
    for color, variable in _VARIABLES.items():
        text = text.replace(color, variable)
    width, height = (math.ceil(96 * side) for side in size)
    return re.sub(
        r'<svg [^>]*?viewBox="([^"]*)"[^>]*>',
        rf'<svg viewBox="\1" width="{width}" height="{height}" role="img" aria-label="{escape(told)}">',
        text,
        count=1,
    )
