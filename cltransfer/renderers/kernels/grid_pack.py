"""Voxel grids in the layout of the kernels, with a map of what is empty."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import ndimage

from . import Array

BRICK = 8  # cells along each side of what is skipped at once
FAR = 255  # bricks; the map holds no larger distance


class Packed(NamedTuple):
    """A grid as the kernels take it."""

    density: Array  # (Z, Y, X) float32, per scene unit
    sh: Array  # (Z, Y, X, 3 K) float32
    label: Array  # (Z, Y, X) float32
    bricks: Array  # (z, y, x) uint8: 0 where anything is, else how many bricks away the nearest such brick is
    low: Array  # (3,) float64, lower corner as x, y, z, scene units
    voxel: Array  # (3,) float64, x, y, z, scene units


def pack(density: Array, sh: Array, label: Array, aabb: Array) -> Packed:
    """Packed grid of float32 arrays: density (Z, Y, X), sh (Z, Y, X, K, 3), label (Z, Y, X), box (2, 3)."""
    voxel = (aabb[1] - aabb[0]) / (np.array(density.shape[::-1]) - 1)
    return Packed(density, sh.reshape(*density.shape, -1), label, distance_to_matter(density), aabb[0], voxel)


def distance_to_matter(density: Array) -> Array:
    """Per brick of 8^3 cells, the chessboard distance to the nearest brick that holds density, (z, y, x) uint8.

    A cell reaches from a vertex to the next, so a brick owns nine vertices a side.
    """
    cells = np.array(density.shape) - 1
    bricks = -(-cells // BRICK)
    padded = np.zeros(bricks * BRICK + 1, bool)
    padded[tuple(slice(n) for n in density.shape)] = density > 0
    full = padded
    for axis in range(3):
        starts = np.arange(bricks[axis]) * BRICK
        last = np.take(full, starts + BRICK, axis)
        full = np.logical_or.reduceat(full, starts, axis) | last
    if not full.any():
        return np.full(bricks, FAR, np.uint8)
    return ndimage.distance_transform_cdt(~full, "chessboard").clip(0, FAR).astype(np.uint8)
