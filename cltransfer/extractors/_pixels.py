"""Images as OpenCV and networks want them."""

from __future__ import annotations

import cv2
import numpy as np
from torch import Tensor

from ..computer.memory import require_free

MOST = 4096  # side of what a network is asked for [px]; a config may be anybody's
PIXEL = 32  # bytes while a frame is made a network's input
IMAGENET_MEAN, IMAGENET_STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # of RGB in [0, 1]

Channels = tuple[float, float, float]


def require_input(model: str, count: int, size: tuple[int, int], hint: str) -> None:
    """Refuse ``count`` frames of ``size`` (W, H) [px] that there is no memory for to make them a network's input.

    Raises:
        ResourceError: less is free.
    """
    what = f"frames at {size[0]}x{size[1]} for the network"
    require_free(count * size[0] * size[1] * PIXEL, model, what, hint)


def to_uint8(image: Tensor) -> np.ndarray:
    """RGB (B, 3, H, W) in [0, 1] as (B, H, W, 3) uint8, rounded; what is below 0 is 0, above 1 is 255."""
    planes = image.detach().cpu().float().numpy()
    pixels = np.empty((len(planes), *planes.shape[2:], 3), np.uint8)
    for frame, channels in zip(pixels, planes):  # 1 to 2 ms a frame of 480x908, against 15 ms by torch
        cv2.merge([cv2.convertScaleAbs(np.maximum(channel, 0), alpha=255) for channel in channels], frame)
    return pixels


def resized(images: np.ndarray, size: tuple[int, int], growing: int = cv2.INTER_LINEAR) -> np.ndarray:
    """Images (B, h, w, 3) uint8 at ``size`` (W, H), (B, H, W, 3) uint8.

    An axis that shrinks is averaged over areas, then one that grows is interpolated by ``growing``, a flag of OpenCV's:
    in one call it averages no areas where either grows, and skips rows or columns of the other.
    """
    least = min(images.shape[2], size[0]), min(images.shape[1], size[1])
    small = (cv2.resize(image, least, interpolation=cv2.INTER_AREA) for image in images)
    return np.stack([cv2.resize(image, size, interpolation=growing) for image in small])


def normalised(rgb: np.ndarray, mean: Channels = IMAGENET_MEAN, std: Channels = IMAGENET_STD) -> np.ndarray:
    """RGB (B, H, W, 3) uint8 as (B, 3, H, W) float32, (value / 255 - mean) / std channel by channel."""
    values = (rgb.astype(np.float32) / 255 - np.array(mean, np.float32)) / np.array(std, np.float32)
    return np.ascontiguousarray(values.transpose(0, 3, 1, 2))
