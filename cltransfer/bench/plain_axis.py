"""Log axes that read in every viewer."""

from __future__ import annotations

from matplotlib.axis import Axis


def plain(axis: Axis) -> None:
    """Plain numbers on a log axis, 2 and 5 between the decades too: powers are not text in every viewer."""
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(lambda value, _: f"{value:g}" if f"{value:.0e}"[0] in "25" else "")
