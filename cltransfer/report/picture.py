"""Pictures as files, by whatever name."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ..storage.files import atomic

QUALITY = 92  # of a JPEG
DRAWABLE = 30_000  # [px] from the picture's corner, up to which OpenCV can draw: its whole numbers end


def pixel(x: float, y: float) -> tuple[int, int]:
    """The pixel that a place lies in: OpenCV counts pixels, of which the first reaches from 0 to 1."""
    return math.floor(x), math.floor(y)


def write_picture(path: Path, picture: NDArray[np.uint8], lasting: bool = True) -> None:
    """Write RGB (H, W, 3) as what the suffix of ``path`` says, whole or not at all.

    OpenCV is not given the name: one that is no UTF-8 ends the interpreter.

    Raises:
        ValueError: the encoder refused it.
        OSError: it could not be written.
    """
    coded = encoded(picture, path.suffix)
    with atomic(path, lasting) as temporary:
        temporary.write_bytes(coded)


def encoded(picture: NDArray[np.uint8], suffix: str, quality: int = QUALITY) -> bytes:
    """RGB (H, W, 3) as what ``suffix`` says; ``quality`` is of a JPEG.

    Raises:
        ValueError: the encoder refused it.
    """
    options = [cv2.IMWRITE_JPEG_QUALITY, quality] if suffix == ".jpg" else []
    done, coded = cv2.imencode(suffix, picture[..., ::-1], options)
    if not done:
        raise ValueError(f"could not encode a picture of {picture.shape[1]}x{picture.shape[0]} px as {suffix}")
    return coded.tobytes()
