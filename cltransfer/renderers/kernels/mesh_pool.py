"""Several rays a pixel become one value."""

from __future__ import annotations

import numpy as np

from ...computer.compiled import kernel
from . import CACHED, Array, f32


@kernel(**CACHED)
def pool(fine: tuple[Array, ...], samples: int, planes: tuple[Array, ...], image: Array) -> None:
    """Means, and the median depth.

    Args:
        fine: depth, alpha, label (n H, n W) and image (3 or 0, n H, n W) of all rays.
        samples: n, rays a pixel along each axis.
        planes: depth (the lower median of the rays that hit, NaN where fewer than half do), expected depth (their
            mean), alpha and label (means of all), (H, W) float32; written.
        image: mean colour, (3 or 0, H, W) float32; written.
    """
    rays, covers, members, colors = fine
    depth, expected, alpha, label = planes
    hits = np.empty(samples * samples, np.float32)
    share = 1 / (samples * samples)
    for y in range(depth.shape[0]):
        for x in range(depth.shape[1]):
            count, far, cover, member = 0, 0.0, 0.0, 0.0
            for row in range(y * samples, (y + 1) * samples):
                for column in range(x * samples, (x + 1) * samples):
                    cover += covers[row, column]
                    member += members[row, column]
                    z = rays[row, column]
                    if z == z:  # not NaN
                        far += z
                        place = count
                        while place > 0 and hits[place - 1] > z:
                            hits[place] = hits[place - 1]
                            place -= 1
                        hits[place] = z
                        count += 1
            depth[y, x] = hits[(count - 1) // 2] if 2 * count >= len(hits) else f32(np.nan)
            expected[y, x] = far / count if count > 0 else f32(np.nan)
            alpha[y, x], label[y, x] = cover * share, member * share
            for channel in range(len(image)):
                total = 0.0
                for row in range(y * samples, (y + 1) * samples):
                    for column in range(x * samples, (x + 1) * samples):
                        total += colors[channel, row, column]
                image[channel, y, x] = total * share
