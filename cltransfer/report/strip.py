"""A few frames of both clips in one picture, for a paper or a message."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from torch import Tensor

from .picture import write_picture
from .side_by_side import GAP, PAPER, write_line

WIDTH = 320  # [px] of a frame
TALLEST = 4 * WIDTH  # [px]; a JPEG takes 65,535 in all
_BAND = 20  # [px] of the line above a row


def evenly(count: int, columns: int) -> list[int]:
    """Up to ``columns`` of ``count`` frames, the first and the last among them, spread evenly over the clip.

    >>> evenly(24, 4)
    [0, 8, 15, 23]
    """
    return np.unique(np.linspace(0, count - 1, min(columns, count)).round().astype(int)).tolist()


def thumbnail(frame: Tensor) -> np.ndarray:
    """A frame, RGB (3, H, W) uint8, at :data:`WIDTH`, (H', WIDTH, 3) with its shape kept.

    One of more than :data:`TALLEST` is as much smaller, in the middle of paper.
    """
    image = np.ascontiguousarray(frame.permute(1, 2, 0).numpy())
    scale = min(WIDTH / image.shape[1], TALLEST / image.shape[0])
    size = (max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale)))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC)
    picture = np.full((size[1], WIDTH, 3), PAPER, np.uint8)
    left = (WIDTH - size[0]) // 2
    picture[:, left : left + size[0]] = small
    return picture


def strip(reference: Tensor, render: Tensor, times: Tensor, columns: int = 6) -> np.ndarray:
    """Frames spread evenly over the clip, the reference above the render, each row under a line.

    Args:
        reference: RGB (N, 3, H, W) uint8.
        render: RGB (N, 3, H2, W2) uint8.
        times: (N,) [s].
        columns: how many frames at most, >= 1.

    Returns:
        RGB (H3, W3, 3) uint8.

    Raises:
        ValueError: the numbers of frames differ.
    """
    if not len(reference) == len(render) == len(times):
        raise ValueError(f"expected equally many, got {len(reference)}, {len(render)}, {len(times)} frames and times")
    shown = evenly(len(times), columns)
    rows = []
    for name, clip in (("reference", reference), ("transfer", render)):
        frames = [thumbnail(clip[i]) for i in shown]
        line = np.full((_BAND, len(shown) * (WIDTH + GAP) - GAP, 3), PAPER, np.uint8)
        write_line(line, name, right_of=0)
        if name == "reference":
            for column, i in enumerate(shown):
                write_line(line[:, : column * (WIDTH + GAP) + WIDTH], f"{float(times[i]):.2f} s", right_of=None)
        between = np.full((len(frames[0]), GAP, 3), PAPER, np.uint8)
        rows += [line, np.hstack([part for frame in frames for part in (between, frame)][1:])]
    return np.vstack(rows)


def write_strip(path: Path, reference: Tensor, render: Tensor, times: Tensor) -> None:
    """Write :func:`strip` as a JPEG, whole or not at all.

    Raises:
        OSError: it could not be written.
    """
    write_picture(path, strip(reference, render, times))
