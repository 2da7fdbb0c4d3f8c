"""Charts as SVG: over matplotlib's own defaults, whatever its user has set; the same values give the same bytes."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SMALL: Any = {"font.size": 8}  # of charts with several panels
_STYLE: Any = {"svg.fonttype": "none", "svg.hashsalt": "cltransfer", "text.parse_math": False}


def svg(draw: Callable[[Figure], Any], size: tuple[float, float], style: Mapping[str, Any]) -> str:
    """The SVG of a figure of ``size`` [inch] in ``style``, without a date.

    A matplotlibrc counts for nothing, the one of the working folder neither: it may be anybody's.
    """
    import matplotlib.style
    from matplotlib.figure import Figure

    with matplotlib.style.context([_STYLE, dict(style)], after_reset=True):
        figure = Figure(figsize=size, layout="constrained")
        draw(figure)
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None})
    return text.getvalue()
