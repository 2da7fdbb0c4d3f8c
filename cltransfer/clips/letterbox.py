"""Black bars about the picture of a film, which belong to the file and not to the frame."""

from __future__ import annotations

import torch
from torch import Tensor

BLACK = 24  # of 255: a pixel no brighter on any frame may belong to a bar
FULL = 0.5  # part of the picture's first row or column that must be brighter: bars end at once
WHOLE = 0.9  # the same of a picture that takes less than half of either side, as things before black do too
EVEN = 0.25  # by which the two bars may differ, of the wider one, and two pixels
RING = 0.02  # of the frame: compression lights some pixels of a bar, so far from the picture, at least two rows
LEAST = 0.02  # of the frame that two bars take
MOST = 0.75  # of the frame that two bars take, a phone's upright picture in a wide one 0.684; more is a dark picture


def find_letterbox(image: Tensor) -> tuple[int, int, int, int]:
    """The picture inside the bars that all frames (N, 3, H, W) uint8 have.

    Bars come in pairs of one width, are black on every frame and end in a straight line.

    Returns:
        Left, top, right, bottom [px], right and bottom excluded; the whole frame where there are no bars.
    """
    bright = image.amax(0).amax(0) > BLACK  # (H, W): lit on any frame
    top, bottom = _bars(bright)
    left, right = _bars(bright[top:bottom].T)
    if (top, bottom) == (0, len(bright)):  # rows of a narrow picture are not half lit before its bars beside are gone
        top, bottom = _bars(bright[:, left:right])
    if (left, top, right, bottom) == (0, 0, *bright.T.shape):
        return _small_picture(bright)
    return left, top, right, bottom


def _small_picture(bright: Tensor) -> tuple[int, int, int, int]:
    """What :func:`find_letterbox` finds of pixels (H, W) of which no row and no column is half lit."""
    columns = bright.any(0).nonzero()[:, 0].tolist() or [0]
    top, bottom = _bars(bright[:, columns[0] : columns[-1] + 1], WHOLE)
    left, right = _bars(bright[top:bottom].T, WHOLE)
    found, whole = (left, top, right, bottom), (0, 0, *bright.T.shape)
    return whole if any(a == b for a, b in zip(found, whole)) else found


def _bars(bright: Tensor, least: float = FULL) -> tuple[int, int]:
    """First and last + 1 of the rows between two bars of (H, W); more than ``least`` of the outer ones is lit."""
    count = len(bright)
    share = bright.float().mean(1)
    lit, full = ((share > part).nonzero()[:, 0] for part in (0.0, least))
    if len(full) == 0:
        return 0, count
    first, last = int(full[0]), int(full[-1]) + 1
    before, after = first, count - last
    even = abs(before - after) <= max(2, EVEN * max(before, after))
    sharp = max(first - int(lit[0]), int(lit[-1]) + 1 - last) <= max(2, RING * count)
    if min(before, after) > 0 and even and sharp and LEAST * count <= before + after <= MOST * count:
        return first, last
    return 0, count


def cropped(image: Tensor, picture: tuple[int, int, int, int]) -> Tensor:
    """``image`` (N, 3, H, W) without what is outside ``picture``."""
    left, top, right, bottom = picture
    return torch.narrow(torch.narrow(image, 2, top, bottom - top), 3, left, right - left).contiguous()
