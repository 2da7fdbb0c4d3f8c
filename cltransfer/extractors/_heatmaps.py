"""From what a top-down pose network puts out to joints: heatmaps (HRNet, ViTPose) and SimCC (RTMPose).

Places are cells, and cell 0 has its centre at 0, as these networks are trained.
"""

from __future__ import annotations

import cv2
import numpy as np

BLUR = 11  # side of DARK's Gaussian [cells], sigma 2: that of the training targets


def peaks(maps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places (N, K, 2) as x, y of the largest values (N, K) of ``maps`` (N, K, H, W)."""
    flat = maps.reshape(*maps.shape[:2], -1)
    best = flat.argmax(-1)
    y, x = np.divmod(best, maps.shape[3])
    return np.stack([x, y], axis=-1), np.take_along_axis(flat, best[..., None], -1)[..., 0]


def quarter_offset(maps: np.ndarray, places: np.ndarray) -> np.ndarray:
    """A quarter cell towards the higher neighbour, (N, K, 2) (https://arxiv.org/abs/1603.06937)."""
    near, inner = _neighbours(maps, places)
    slope = np.stack([near[..., 1, 2] - near[..., 1, 0], near[..., 2, 1] - near[..., 0, 1]], axis=-1)
    return 0.25 * np.sign(slope) * inner


def dark_offset(maps: np.ndarray, places: np.ndarray) -> np.ndarray:
    """From the cell to the top of the parabola through its neighbours' logarithms, (N, K, 2), at most one cell.

    DARK (https://arxiv.org/abs/1910.06278): blurred as the training targets were, a map is nearly a Gaussian,
    whose logarithm is a parabola. Without a top there the offset is 0.
    """
    near, inner = _neighbours(np.log(np.maximum(_blurred(maps), 1e-10)), places)
    slope = np.stack([near[..., 1, 2] - near[..., 1, 0], near[..., 2, 1] - near[..., 0, 1]], axis=-1) / 2
    xx = near[..., 1, 2] - 2 * near[..., 1, 1] + near[..., 1, 0]
    yy = near[..., 2, 1] - 2 * near[..., 1, 1] + near[..., 0, 1]
    xy = (near[..., 2, 2] - near[..., 0, 2] - near[..., 2, 0] + near[..., 0, 0]) / 4
    determinant = xx * yy - xy * xy
    is_top = (determinant > 0) & (xx < 0)
    x = xy * slope[..., 1] - yy * slope[..., 0]
    y = xy * slope[..., 0] - xx * slope[..., 1]
    offset = np.stack([x, y], axis=-1) / np.where(is_top, determinant, 1.0)[..., None]
    return np.clip(offset, -1, 1) * (is_top[..., None] & inner)


def simcc_joints(x: np.ndarray, y: np.ndarray, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Places and scores of one distribution along each axis (https://arxiv.org/abs/2107.03332).

    Args:
        x: (N, K, bins along the width).
        y: (N, K, bins along the height).
        size: of the network's input (W, H) [px]; there are a whole number of bins a pixel, as a rule two.

    Returns:
        Places (N, K, 2) [px of the input], and the smaller of the two maxima (N, K).
    """
    bins = np.stack([x.argmax(-1), y.argmax(-1)], axis=-1)
    scale = np.array(size) / np.array([x.shape[-1], y.shape[-1]])
    return bins * scale, np.minimum(x.max(-1), y.max(-1))


def _neighbours(maps: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (N, K, 3, 3), row before column, about ``places``, and whether they are all in the map, (N, K, 1)."""
    height, width = maps.shape[2:]
    center = np.clip(places, 1, [width - 2, height - 2])
    rows = center[..., 1, None, None] + np.array([[-1], [0], [1]])
    columns = center[..., 0, None, None] + np.array([[-1, 0, 1]])
    pose, joint = np.ogrid[: maps.shape[0], : maps.shape[1]]
    return maps[pose[..., None, None], joint[..., None, None], rows, columns], (center == places).all(-1)[..., None]


def _blurred(maps: np.ndarray) -> np.ndarray:
    blurred = np.empty_like(maps)
    for planes, out in zip(maps.reshape(-1, *maps.shape[2:]), blurred.reshape(-1, *maps.shape[2:])):
        cv2.GaussianBlur(planes, (BLUR, BLUR), 0, dst=out, borderType=cv2.BORDER_CONSTANT)
    return blurred
