"""Images as OpenCV and networks want them."""

from __future__ import annotations

import cv2
import numpy as np
from torch import Tensor


def to_uint8(image: Tensor) -> np.ndarray:
    """RGB (B, 3, H, W) in [0, 1] as (B, H, W, 3) uint8, rounded."""
    planes = image.detach().cpu().float().numpy()
    pixels = np.empty((len(planes), *planes.shape[2:], 3), np.uint8)
    for frame, channels in zip(pixels, planes):  # 0.5 ms a frame of 480x908, against 15 ms by torch
        cv2.merge([cv2.convertScaleAbs(channel, alpha=255) for channel in channels], frame)
    return pixels
