"""Inner loops of the scene extractors: one pass over the pixels of a batch."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..computer.compiled import kernel


@kernel(nogil=True)
def static_flow(depth: NDArray, turn: NDArray, shift: NDArray, size: tuple[float, float]) -> NDArray:
    """Backward flow (B, 2, H, W) float32 [px of ``size``] of a static scene; NaN where undefined.

    A pixel p = (x, y, 1) at depth d was at ``turn @ p * d + shift`` in the frame before (homogeneous pixels);
    ``depth`` is (B, H, W), ``turn`` (B, 3, 3), ``shift`` (B, 3), ``size`` (W, H) [px].
    """
    batch, height, width = depth.shape
    flow = np.full((batch, 2, height, width), np.nan, np.float32)
    for b in range(batch):
        T, s = turn[b], shift[b]
        for row in range(height):
            y = (row + 0.5) * size[1] / height
            for column in range(width):
                x = (column + 0.5) * size[0] / width
                d = float(depth[b, row, column])
                ahead = (T[2, 0] * x + T[2, 1] * y + T[2, 2]) * d + s[2]
                if ahead > 0 and ahead < math.inf:  # False where d is NaN
                    flow[b, 0, row, column] = ((T[0, 0] * x + T[0, 1] * y + T[0, 2]) * d + s[0]) / ahead - x
                    flow[b, 1, row, column] = ((T[1, 0] * x + T[1, 1] * y + T[1, 2]) * d + s[1]) / ahead - y
    return flow
