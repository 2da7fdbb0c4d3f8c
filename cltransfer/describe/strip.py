"""A clip as a strip: frames, shot size, angle and movement over time in one picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import interpolate

from ..report.svg import SMALL, svg
from ..storage.files import write_text
from .description import Description
from .motion import PRIMITIVES
from .movement import STILL
from .shot_scale import SCALES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HIGH = 120  # [px] of the frames
WIDE = 7.2  # width of their row over its height
ALONE = 1.0  # [s] that one frame alone is drawn over
DOTS: Any = {"marker": "o", "markersize": 1.5}  # one frame, or one between two that were not read, is no line
STYLE: Any = {**SMALL, "axes.titlesize": 9}


def write_strip(path: Path, shown: Description, image: Tensor | None) -> None:
    """Write the strip as SVG; the same values give the same bytes.

    Args:
        path: ``.svg``.
        shown: what to draw.
        image: its frames, (N, 3, H, W) uint8, None where there are none.
    """
    rows = [1.0, 1.3, 1.3, 1.6] if image is not None else [1.3, 1.3, 1.6]
    write_text(path, svg(lambda figure: _draw(figure, rows, shown, image), (8.0, 1.1 * sum(rows)), STYLE))


def _draw(figure: Figure, rows: list[float], shown: Description, image: Tensor | None) -> None:
    axes = figure.subplots(len(rows), 1, sharex=True, squeeze=False, height_ratios=rows)[:, 0]
    if image is not None:
        _thumbnails(axes[0], shown.times, image)
    for track, ax in zip((_scale, _angle, _movement), axes[-3:]):
        track(ax, shown)
        ax.spines[["top", "right"]].set_visible(False)
        ax.grid(axis="y", linewidth=0.3)
    axes[-1].set_xlabel("time [s]")
    if len(shown.times) == 1:
        axes[-1].set_xlim(_span(shown.times))
        axes[-1].set_xticks([float(shown.times[0])], [f"{float(shown.times[0]):.2f}"])


def _thumbnails(ax: Axes, times: Tensor, image: Tensor) -> None:
    height, width = image.shape[2:]
    # where there are fewer frames than there is room for, each stands several times, lest they are drawn out wide
    count = max(2, round(WIDE * height / width))
    moments = torch.linspace(float(times[0]), float(times[-1]), count, dtype=times.dtype)  # each within its own tile
    picked = (times - moments[:, None]).abs().argmin(1)
    small = interpolate(image[picked].float(), (HIGH, max(1, HIGH * width // height)), mode="area")
    strip = np.concatenate(list(small.permute(0, 2, 3, 1).round().byte().numpy()), axis=1)
    ax.imshow(strip, extent=(*_span(times), 0, 1), aspect="auto", interpolation="none")
    ax.set_axis_off()


def _span(times: Tensor) -> tuple[float, float]:
    """From where to where the time goes [s]: one frame alone has none, and stands in the middle of a second."""
    beside = ALONE / 2 if len(times) == 1 else 0.0
    return float(times[0]) - beside, float(times[-1]) + beside


def _scale(ax: Axes, shown: Description) -> None:
    index = shown.tracks["scale"].index
    values = np.where(index.numpy() >= 0, index.numpy(), np.nan)
    ax.plot(shown.times, values, drawstyle="steps-mid", marker=".", markersize=3)
    ax.set_yticks(range(len(SCALES)), SCALES)
    ax.set_ylim(len(SCALES) - 0.5, -0.5)
    ax.set_title(f"shot size: {shown.tracks['scale'].usual() or 'not told'}", loc="left")


def _angle(ax: Axes, shown: Description) -> None:
    for column, name in enumerate(("yaw", "pitch", "roll")):
        degrees = torch.rad2deg(shown.orientation[:, column]).numpy()
        round_back = np.flatnonzero(np.abs(np.diff(degrees)) > 180) + 1  # a line that goes round is broken there
        ax.plot(np.insert(shown.times, round_back, np.nan), np.insert(degrees, round_back, np.nan), label=name, **DOTS)
    words = [shown.tracks[name].usual() for name in ("height", "side", "dutch")]
    ax.set_title(f"angle [degrees]: {', '.join(word for word in words if word) or 'not told'}", loc="left")
    ax.legend(frameon=False, ncols=3, loc="lower right", bbox_to_anchor=(1, 1), borderpad=0)


def _movement(ax: Axes, shown: Description) -> None:
    track = shown.motion.track
    for i, name in enumerate(PRIMITIVES):
        if float(track[:, i].abs().max()) > STILL:
            ax.plot(shown.times, track[:, i], label=name, **DOTS)
    if ax.lines:  # beside it: above it the words may take all of its width
        ax.legend(frameon=False, loc="upper left", bbox_to_anchor=(1, 1), borderaxespad=0)
    else:
        ax.set_ylim(-10 * STILL, 10 * STILL)
    ax.set_title(f"movement [frame sides]: {shown.movement.text}", loc="left")
