"""Triangles of polygons: a fan where that covers no more than the polygon does, else by clipping its ears."""

from __future__ import annotations

import numpy as np

from ...computer.array_type import Array

FLAT = 1e-9  # of a polygon's area, by which a triangle of its fan may look the other way


def fans_hold(points: Array) -> Array:
    """Whether the fan from the first corner is the polygon, (P,) bool, of corners (P, k, 3) in order around.

    It is not where the polygon has an inlet, as a wall has that was cut out for a door: a fan closes it.
    """
    twice, normal = _fan(points)
    area = np.linalg.norm(normal, axis=1, keepdims=True)
    along = np.einsum("pti,pi->pt", twice, normal)
    return np.asarray(~(along < -FLAT * area**2).any(1))  # nothing is clipped of a corner that is nowhere, NaN


def triangles_of(points: Array) -> Array:
    """Corners of the triangles of one polygon with corners (k, 3), (T, 3) int64, around as the polygon."""
    fan = fan_of(len(points))
    if bool(fans_hold(points[None])[0]):
        return fan
    import mapbox_earcut

    found = mapbox_earcut.triangulate_float64(_flat(points), np.array([len(points)], np.uint32))
    return np.asarray(found, np.int64).reshape(-1, 3)


def fan_of(corners: int) -> Array:
    """Corners of the triangles of the fan from the first one, (corners - 2, 3) int64.

    >>> fan_of(4).tolist()
    [[0, 1, 2], [0, 2, 3]]
    """
    second = np.arange(1, corners - 1)
    return np.stack([np.zeros_like(second), second, second + 1], axis=1)


def _fan(points: Array) -> tuple[Array, Array]:
    """Twice the area along the normal, of each triangle of the fans (P, k - 2, 3), and of the polygons (P, 3)."""
    spokes = points[:, 1:] - points[:, :1]
    twice = np.cross(spokes[:, :-1], spokes[:, 1:])
    return twice, twice.sum(1)


def _flat(points: Array) -> Array:
    """Corners (k, 3) in the polygon's plane, (k, 2), counter-clockwise."""
    normal = _fan(points[None])[1][0]
    normal = normal / np.linalg.norm(normal)
    across = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    across /= np.linalg.norm(across)
    return np.ascontiguousarray((points - points[0]) @ np.stack([across, np.cross(normal, across)], axis=1))
