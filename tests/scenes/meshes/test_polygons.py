"""A polygon's triangles cover it, and nothing beside it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from cltransfer.scenes.meshes.polygons import fans_hold, triangles_of

WALL = [(0, 0), (1.5, 0), (1.5, 2), (2.5, 2), (2.5, 0), (4, 0), (4, 3), (0, 3)]  # with a door, area 10
ARROW = [(0, 0), (4, 2), (0, 4), (1, 2)]  # a quad, area 6
STRAIGHT = [(0, 0), (1, 0), (2, 0), (2, 2), (0, 2)]  # three corners on a line, area 4


def turned(corners: list[tuple[float, float]]) -> NDArray[np.float64]:
    """In a plane that is none of the axes'."""
    across, up = np.array([2, 1, -2]) / 3, np.array([1, 2, 2]) / 3
    return np.array(corners) @ np.stack([across, up]) + [5, -3, 7]


def areas(points: NDArray[np.float64], triangles: NDArray[np.int64]) -> NDArray[np.float64]:
    """Signed, against the normal of :func:`turned`."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    normal: NDArray[np.float64] = np.cross(np.array([2, 1, -2]) / 3, np.array([1, 2, 2]) / 3)
    return np.asarray(np.cross(b - a, c - a) @ normal / 2)


@pytest.mark.parametrize(("corners", "area"), [(WALL, 10), (ARROW, 6), (STRAIGHT, 4)])
def test_its_triangles_have_its_area_and_look_where_it_does(corners: list[tuple[float, float]], area: float) -> None:
    for start in range(len(corners)):  # whichever corner is named first
        points = turned([*corners[start:], *corners[:start]])
        for way, sign in ((points, 1), (points[::-1], -1)):
            found = sign * areas(way, triangles_of(way))
            assert found.min() >= -1e-9
            assert found.sum() == pytest.approx(area)


def test_a_fan_is_left_where_it_holds() -> None:
    assert fans_hold(np.stack([turned(ARROW[3:] + ARROW[:3]), turned(ARROW)])).tolist() == [True, False]
    assert triangles_of(turned([(0, 0), (2, 0), (2, 1), (0, 1)])).tolist() == [[0, 1, 2], [0, 2, 3]]
    assert fans_hold(np.zeros((1, 5, 3))).tolist() == [True]  # of nothing
    assert fans_hold(np.array([[*turned(ARROW[:3]), [np.nan] * 3]])).tolist() == [True]  # it is left out later
