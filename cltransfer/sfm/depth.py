"""Depth maps of frames from the sparse points that stand in them."""

from __future__ import annotations

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from .points import Points


def spread_depth(points: Points, subject: Tensor, reach: float, min_confidence: float) -> tuple[Tensor, Tensor]:
    """Each pixel takes depth and confidence of the nearest point on its side of the subject's outline.

    A layer's depth is the mode over its pixels, so a point counts for the area around it, however crowded the points
    are where there is much to see. Nothing is made up between two points: a pixel has the depth of one or none.

    Args:
        points: sightings in N frames.
        subject: the person's pixels, (N, H, W) bool.
        reach: how far a pixel may be from its point [frame widths].
        min_confidence: points less sure are left out.

    Returns:
        Depth and confidence, (N, H, W) float32 each, the depth in the unit of the points; NaN out of reach.
    """
    maps = torch.full((2, *subject.shape), torch.nan)
    sure = points.confidence >= min_confidence
    for frame in range(len(subject)):
        chosen = sure & (points.frames == frame)
        if bool(chosen.any()):
            values = torch.stack([points.depth[chosen], points.confidence[chosen]]).float().numpy()
            spread = _nearest(points.pixels[chosen].numpy(), values, subject[frame].cpu().numpy(), reach)
            maps[:, frame] = torch.from_numpy(spread)
    return maps[0], maps[1]


def _nearest(pixels: NDArray, values: NDArray, subject: NDArray, reach: float) -> NDArray:
    """``values`` (V, P) of points at ``pixels`` (P, 2) spread over a frame, (V, H, W)."""
    height, width = subject.shape
    column, row = pixels.astype(int).clip(0, [width - 1, height - 1]).T
    spread = np.full((len(values), height, width), np.nan, np.float32)
    for side in (subject, ~subject):
        mine = side[row, column]
        if not mine.any():
            continue
        free = np.ones((height, width), np.uint8)
        free[row[mine], column[mine]] = 0
        far, label = cv2.distanceTransformWithLabels(free, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
        of_label = np.zeros((len(values), int(label.max()) + 1), np.float32)
        of_label[:, label[row[mine], column[mine]]] = values[:, mine]
        inside = side & (far <= reach * width)
        spread[:, inside] = of_label[:, label[inside]]
    return spread
