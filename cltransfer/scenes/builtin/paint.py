"""Colours of procedural surfaces and the light baked into them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .surfaces import Array, Cells, Surface

RGB = tuple[float, float, float]
Paint = Callable[[Array, np.random.Generator], Array]  # uv (N, 2) [m] -> RGB (N, 3) in [0, 1]


@dataclass(frozen=True)
class Part:
    """A painted surface of a set.

    Args:
        surface: its geometry.
        paint: its colours.
        spacing: width of its cells [m].
        subject: whether it belongs to the person.
        rough: how far cells are scattered off the surface [m]; leaves are, stone is not.
        lit: whether light and shadow fall on it; the sky shines by itself.
    """

    surface: Surface
    paint: Paint
    spacing: float
    subject: bool = False
    rough: float = 0.0
    lit: bool = True


def plain(color: RGB, grain: float = 0.03) -> Paint:
    """One colour with a little random brightness per cell."""

    def paint(uv: Array, rng: np.random.Generator) -> Array:
        return np.asarray(color) * (1 + grain * rng.standard_normal((len(uv), 1)))

    return paint


def checker(light: RGB, dark: RGB, tile: float) -> Paint:
    """Square tiles ``tile`` [m] wide, each with a tone of its own."""

    def paint(uv: Array, rng: np.random.Generator) -> Array:
        index = np.floor(uv / tile).astype(int)
        tone = 1 + 0.06 * rng.standard_normal(index.max(0) + 1)[index[:, 0], index[:, 1]]
        return np.where((index.sum(1) % 2 == 0)[:, None], light, dark) * tone[:, None]

    return paint


def bricks(color: RGB, size: tuple[float, float] = (0.9, 0.3)) -> Paint:
    """Courses of blocks of ``size`` [m], each second course shifted by half a block."""

    def paint(uv: Array, rng: np.random.Generator) -> Array:
        row = np.floor(uv[:, 1] / size[1]).astype(int)
        column = np.floor(uv[:, 0] / size[0] + 0.5 * (row % 2)).astype(int)
        tone = 1 + 0.13 * rng.standard_normal((column.max() + 1, row.max() + 1))[column, row]
        return np.asarray(color) * tone[:, None]

    return paint


def openings(wall: Paint, dark: RGB, period: float, width: float, band: tuple[float, float]) -> Paint:
    """Arches in ``wall``, one each ``period`` [m]: ``width`` [m] wide, straight sides over ``band`` [m]."""

    def paint(uv: Array, rng: np.random.Generator) -> Array:
        across = np.abs(np.mod(uv[:, 0], period) - period / 2)
        inside = (across < width / 2) & (uv[:, 1] > band[0]) & (uv[:, 1] < band[1])
        inside |= (uv[:, 1] >= band[1]) & (np.hypot(across, uv[:, 1] - band[1]) < width / 2)
        return np.where(inside[:, None], dark, wall(uv, rng))

    return paint


def stripes(first: RGB, second: RGB, width: float) -> Paint:
    """Stripes across u, ``width`` [m] each."""

    def paint(uv: Array, rng: np.random.Generator) -> Array:
        return np.where((np.floor(uv[:, :1] / width) % 2) == 0, first, second)

    return paint


def fade(bottom: RGB, top: RGB, height: float) -> Paint:
    """From one colour to another over ``height`` [m] of v: a sky."""

    def paint(uv: Array, rng: np.random.Generator) -> Array:
        share = np.clip(uv[:, 1:] / height, 0, 1)
        return np.asarray(bottom) * (1 - share) + np.asarray(top) * share

    return paint


def visibility(center: Array, occluders: Array, direction: Array, pixel: float, bias: float) -> Array:
    """Share of light from ``direction`` (3,) that reaches each of ``center`` (N, 3), in [0, 1].

    A shadow map is seen along the light, has cells of ``pixel`` [m] and holds the nearest of ``occluders``
    (M, 3); four cells around a point are compared, so edges are soft. ``bias`` [m] keeps a surface from
    shading itself.
    """
    across = np.cross(direction, [0.1, 1.0, 0.3])
    across /= np.linalg.norm(across)
    frame = np.stack([across, np.cross(direction, across), direction], 1)
    seen = occluders @ frame
    low = seen[:, :2].min(0)
    shape = (np.ptp(seen[:, :2], axis=0) / pixel).astype(int) + 3
    nearest = np.full(tuple(shape), -np.inf)
    index = ((seen[:, :2] - low) / pixel).astype(int)
    np.maximum.at(nearest, (index[:, 0], index[:, 1]), seen[:, 2])

    points = center @ frame
    place = (points[:, :2] - low) / pixel - 0.5
    corner = np.clip(np.floor(place).astype(int), 0, shape - 2)
    share = np.clip(place - corner, 0, 1)
    light = np.zeros(len(points))
    for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
        weight = np.abs(1 - i - share[:, 0]) * np.abs(1 - j - share[:, 1])
        light += weight * (nearest[corner[:, 0] + i, corner[:, 1] + j] <= points[:, 2] + bias)
    return light


def shade(cells: Cells, occluders: Array, sun: Array) -> Array:
    """Light on each cell as RGB factors, (N, 3): a warm sun with shadows, a cool sky, a little from below.

    The sky is nine directions over the upper half, so corners and contacts are darker: depth reads at once.
    """
    normal = cells.normal
    raised = cells.center + 0.15 * normal  # off the surface, so that a plane does not shade itself
    lit = visibility(raised, occluders, sun, 0.12, 0.15) * np.clip(normal @ sun, 0, 1)
    sky = np.zeros(len(cells))
    turns = np.arange(8) * 2 * np.pi / 8
    directions = [np.array([0.0, 0.0, 1.0])] + [np.array([np.cos(t) * 0.77, np.sin(t) * 0.77, 0.64]) for t in turns]
    for direction in directions:
        facing = np.clip(normal @ direction, 0, 1)
        sky += facing * visibility(raised, occluders, direction, 0.2, 0.25) / len(directions)
    below = 0.5 - 0.5 * normal[:, 2]
    warm, cool, earth = (
        np.array([1.02, 0.93, 0.78]),
        np.array([0.80, 0.90, 1.04]),
        np.array([0.34, 0.31, 0.27]),
    )
    return lit[:, None] * warm + sky[:, None] * cool + (0.12 + below[:, None]) * earth
