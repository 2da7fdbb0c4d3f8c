"""Two clips in one picture, for the eye."""

from __future__ import annotations

import cv2
import numpy as np
import torch
from torch import Tensor

from ..clips.decoding import PIXEL_LIMIT

GAP = 4  # [px] between two frames
_INK, PAPER = (235, 235, 235), 18  # RGB of text, grey of the ground


def side_by_side(reference: Tensor, render: Tensor, times: Tensor) -> Tensor:
    """Frames of both beside each other, equally high, under a line with their names and the time.

    Both are smaller where together they would be larger than a clip may be.

    Args:
        reference: RGB (N, 3, H, W) uint8.
        render: RGB (N, 3, H2, W2) uint8.
        times: (N,) [s].

    Returns:
        (N, 3, H3, W3) uint8; both sides are even, as video encoders want them.

    Raises:
        ValueError: the numbers of frames differ.
    """
    if not len(reference) == len(render) == len(times):
        raise ValueError(f"expected equally many, got {len(reference)}, {len(render)}, {len(times)} frames and times")
    height = _height(reference, render)
    left, right = _to_height(reference, height), _to_height(render, height)
    band = _band(height)
    width = left.shape[2] + GAP + right.shape[2]
    sheet = np.full((len(left), *_sheet(height, width), 3), PAPER, np.uint8)
    sheet[:, :band] = _captions(band, sheet.shape[2], left.shape[2] + GAP)
    sheet[:, band : band + height, : left.shape[2]] = left
    sheet[:, band : band + height, left.shape[2] + GAP : width] = right
    for frame, time in zip(sheet, times.tolist()):
        write_line(frame[:band], f"{time:.2f} s", right_of=None)
    return torch.from_numpy(sheet).permute(0, 3, 1, 2)


def reference_side(sheet: Tensor) -> Tensor:
    """The reference's frames out of what :func:`side_by_side` made of two clips of one shape, to a pixel.

    Args:
        sheet: RGB (N, 3, H3, W3) uint8.

    Returns:
        (N, 3, H, W) uint8.

    Raises:
        ValueError: no two frames have that height together.
    """
    total, width = sheet.shape[2:]
    height = next((h for h in range(total, 0, -1) if _sheet(h, width)[0] == total), None)
    if height is None or width <= GAP:
        raise ValueError(f"expected two clips side by side, got {width}x{total} px")
    top = _band(height)
    return sheet[:, :, top : top + height, : (width - GAP) // 2]


def _height(reference: Tensor, render: Tensor) -> int:
    """Height of the higher one, or as much of it as makes a sheet that can be read again as a clip."""
    highest = max(reference.shape[2], render.shape[2])
    for height in range(highest, 1, -1):
        rows, columns = _sheet(height, _width(reference, height) + GAP + _width(render, height))
        if rows * columns <= PIXEL_LIMIT:
            return height
    return 1


def _sheet(height: int, width: int) -> tuple[int, int]:
    """Rows and columns, both even, of a sheet of frames of ``height`` that are ``width`` wide together [px]."""
    return (_band(height) + height + 1) // 2 * 2, (width + 1) // 2 * 2


def _band(height: int) -> int:
    """Height of the line above frames of ``height`` [px]."""
    return max(18, height // 16)


def _width(clip: Tensor, height: int) -> int:
    """Width of frames (N, 3, H, W) at ``height``, their shape kept."""
    return max(1, round(clip.shape[3] * height / clip.shape[2]))


def _to_height(clip: Tensor, height: int) -> np.ndarray:
    """(N, height, W', 3), resized with its shape kept."""
    frames = np.ascontiguousarray(clip.permute(0, 2, 3, 1).numpy())
    if frames.shape[1] == height:
        return frames
    size, how = (_width(clip, height), height), cv2.INTER_CUBIC if height > frames.shape[1] else cv2.INTER_AREA
    return np.stack([cv2.resize(frame, size, interpolation=how) for frame in frames])


def _captions(band: int, width: int, second: int) -> np.ndarray:
    """The line above the frames, (band, width, 3), with what does not change."""
    line = np.full((band, width, 3), PAPER, np.uint8)
    write_line(line, "reference", right_of=0)
    write_line(line, "transfer", right_of=second)
    return line


def write_line(line: np.ndarray, text: str, right_of: int | None) -> None:
    """Text in a line (band, W, 3), from a column on, or at the right end where that is None."""
    scale = 0.55 * line.shape[0] / 20
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, scale, 1)
    start = line.shape[1] - width - 6 if right_of is None else right_of + 6
    place = (start, (line.shape[0] + height) // 2)
    cv2.putText(line, text, place, cv2.FONT_HERSHEY_DUPLEX, scale, _INK, 1, cv2.LINE_AA)
