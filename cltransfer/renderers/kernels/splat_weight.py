"""How much each Gaussian contributes to an image: what importance pruning asks for."""

from __future__ import annotations

import numpy as np

from ...computer.compiled import kernel
from . import CACHED, Array, f32
from .splat_composite import MAX_ALPHA, MIN_TRANSMITTANCE
from .splat_cull import View
from .splat_pack import MIN_ALPHA
from .splat_project import PEAK, QA, QB, QC, SOURCE, TILE, X0, X1, Y0, Y1, Slab, Tiles, U, V

_HALF, _ONE, _ZERO = f32(0.5), f32(1), f32(0)
_MIN_ALPHA, _MAX_ALPHA, _MIN_TRANSMITTANCE = f32(MIN_ALPHA), f32(MAX_ALPHA), f32(MIN_TRANSMITTANCE)


@kernel(**CACHED)
def weigh(view: View, slab: Slab, tiles: Tiles, transmittance: Array, weights: Array) -> int:
    """Raise ``weights`` to the greatest share of a pixel that each Gaussian of a slab has; return the open tiles.

    Args:
        view: the camera.
        slab: projected Gaussians.
        tiles: their lists; tiles in which every pixel is opaque are closed.
        transmittance: what is left of each pixel, (H, W) float32, 1 at first; 0 where it is finished.
        weights: (V,) float32, by row of the packed Gaussians.
    """
    record, box = slab.records, slab.boxes
    columns = (view.width + TILE - 1) // TILE
    still_open = 0
    for tile in range(len(tiles.closed)):
        if tiles.closed[tile]:
            continue
        left, top = tile % columns * TILE, tile // columns * TILE
        right, bottom = min(left + TILE, view.width), min(top + TILE, view.height)
        for pair in range(tiles.starts[tile], tiles.starts[tile + 1]):
            k = tiles.pairs[pair]
            greatest = _ZERO
            for y in range(max(box[k, Y0], top), min(box[k, Y1] + 1, bottom)):
                dy = f32(y) + _HALF - record[k, V]
                for x in range(max(box[k, X0], left), min(box[k, X1] + 1, right)):
                    dx = f32(x) + _HALF - record[k, U]
                    power = record[k, QC] * dy * dy + dx * (record[k, QB] * dy + record[k, QA] * dx)
                    alpha = min(record[k, PEAK] * np.exp(power), _MAX_ALPHA)
                    if alpha < _MIN_ALPHA:
                        continue
                    after = transmittance[y, x] * (_ONE - alpha)
                    if after < _MIN_TRANSMITTANCE:  # it ends the pixel and is not added
                        transmittance[y, x] = _ZERO
                        continue
                    greatest = max(greatest, transmittance[y, x] * alpha)
                    transmittance[y, x] = after
            weights[box[k, SOURCE]] = max(weights[box[k, SOURCE]], greatest)
        tiles.closed[tile] = not transmittance[top:bottom, left:right].any()
        still_open += 1 - tiles.closed[tile]
    return still_open
