"""A place to film in, before it is cut into cells. Metres, z up; the person stands at the origin and faces +x."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .mannequin import Body
from .paint import Part
from .surfaces import Array, Cells, Surface

Spot = tuple[float, float]  # x, y [m]
Axes = tuple[tuple[float, float, float], ...]  # rows: what x, y, z of the set become in the scene

Z_UP: Axes = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
Y_UP: Axes = ((0, 0, 1), (1, 0, 0), (0, 1, 0))
MINUS_Y_UP: Axes = ((1, 0, 0), (0, 0, 1), (0, -1, 0))  # as splats in the wild often have it
AFTERNOON = (0.56, 0.42, 0.714)


@dataclass(frozen=True)
class Place:
    """A person and what is around.

    Args:
        body: the person, at the origin.
        parts: everything else.
        axes: of the scene.
        sun: direction to the light, in the set's axes, any length.
        people: in it, the person among them.
    """

    body: Body
    parts: Sequence[Part]
    axes: Axes = Z_UP
    sun: tuple[float, float, float] = AFTERNOON
    people: int = 1


@dataclass(frozen=True)
class Moved:
    """A surface that was turned by ``yaw`` [rad] about the z axis and put to ``spot``."""

    surface: Surface
    yaw: float
    spot: Spot

    def cells(self, spacing: float) -> Cells:
        """The cells of the surface, moved."""
        cells = self.surface.cells(spacing)
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        turn: Array = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        return Cells(
            cells.center @ turn + np.array([*self.spot, 0.0]), cells.half_u @ turn, cells.half_v @ turn, cells.uv
        )


def bystander(body: Body, yaw: float, spot: Spot) -> list[Part]:
    """A second person, who belongs to the set and not to the subject."""
    return [replace(part, surface=Moved(part.surface, yaw, spot), subject=False) for part in body.parts()]
