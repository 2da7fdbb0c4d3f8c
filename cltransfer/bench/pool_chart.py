"""The chart of runs put together: each clip's total over what the paper's setting reaches on it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from typing import TYPE_CHECKING

from .driver import PAPER, Clip
from .driver_chart import COLORS, LOWEST, floored
from .driver_table import comparable, met

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PANELS = (("total", "total, by the search's own losses"), ("judged", "total, by the judge"))


def draw(figure: Figure, clips: Sequence[Clip]) -> None:
    """Clips across scenes, one dot for each preset; below the diagonal ours is lower."""
    from .plain_axis import plain

    presets = [name for name in dict.fromkeys(clip.preset for clip in clips) if name != PAPER]
    for ax, (value, label) in zip(figure.subplots(1, len(PANELS)), PANELS):
        totals = [1.0]
        for name, color in zip(presets, cycle(COLORS)):
            pairs = met(name, "cross", clips) if value == "judged" or comparable(name) else []
            dots = [(getattr(theirs, value), getattr(ours, value)) for ours, theirs in pairs]
            dots = [(x, y) for x, y in dots if x == x and y == y]
            totals += [total for dot in dots for total in dot]
            dots = [(max(x, LOWEST), max(y, LOWEST)) for x, y in dots]
            x, y = [x for x, _ in dots], [y for _, y in dots]
            ax.scatter(x, y, 12, color=color, alpha=0.55, linewidths=0, label=name)
        low, high = max(min(totals), LOWEST) / 1.3, max(totals) * 1.3
        ax.plot([low, high], [low, high], color="#999999", linewidth=0.8)
        ax.set(xscale="log", yscale="log", xlim=(low, high), ylim=(low, high), aspect="equal")
        ax.set_title(label + floored(totals))
        ax.set_xlabel("the paper's setting")
        ax.set_ylabel("ours; below the line it is lower")
        plain(ax.xaxis)
        plain(ax.yaxis)
        ax.grid(alpha=0.25)
        ax.legend(frameon=False, loc="upper left")
