"""Two open places to film in: what stands where. Metres, z up; the person is at the origin facing +x.

The camera side is +x. Low things stand beside it, columns and walls behind the person at several distances:
every usual view has a foreground, the person and a background.
"""

from __future__ import annotations

import numpy as np

from .drawn import drawn_body, drawn_spots
from .mannequin import Body
from .paint import RGB, Part, bricks, checker, fade, openings, plain, stripes
from .place import MINUS_Y_UP, Place, Spot
from .surfaces import Lathe, Panel, ball, box, capsule

_STONE, _DARK, _LEAF = (0.80, 0.72, 0.60), (0.16, 0.15, 0.17), (0.28, 0.44, 0.20)


def courtyard(rng: np.random.Generator | None = None) -> Place:
    """A walled court with an arcade, a fountain, trees and planters; the target of the built-in transfer.

    ``rng`` draws another person and shifts the planters.
    """
    body = Body(height=1.78, swing=(0.12, -0.08), elbow=(0.35, 0.2)) if rng is None else drawn_body(rng)
    paving = checker((0.66, 0.60, 0.52), (0.50, 0.43, 0.37), 0.6)
    arcade = openings(bricks(_STONE), _DARK, 2.4, 1.4, (0.0, 2.1))
    windows = openings(bricks((0.78, 0.62, 0.48)), (0.22, 0.26, 0.32), 2.0, 0.8, (1.2, 2.2))
    parts = [
        Part(Panel((-6.6, -7.2, 0), (18, 0, 0), (0, 16.8, 0)), paving, 0.15),
        Part(Panel((-6.6, -7.2, 0), (0, 16.8, 0), (0, 0, 5.0)), arcade, 0.16),
        Part(Panel((11.4, -7.2, 0), (-18, 0, 0), (0, 0, 4.2)), windows, 0.25),
        Part(Panel((-6.6, 9.6, 0), (18, 0, 0), (0, 0, 4.2)), windows, 0.25),
        Part(Panel((11.4, 9.6, 0), (0, -16.8, 0), (0, 0, 4.2)), bricks(_STONE), 0.5),
        *surroundings(),
    ]
    for y in np.arange(-6.0, 8.5, 2.4):
        parts += _column((-5.4, y))
    parts += [Part(p, plain((0.66, 0.36, 0.26), 0.1), 0.24) for p in box((-6.6, -7.2, 2.7), (-5.1, 9.6, 2.95))]
    parts += _fountain((-2.6, -2.4))
    for spot, size in (((-3.6, 3.0), 1.1), ((2.2, -5.6), 1.0), ((5.4, 5.8), 1.2)):
        parts += tree(spot, size, _LEAF)
    for spot in drawn_spots(rng, (1.15, -1.0), (0.45, 1.55), (3.3, -1.9), (3.0, 3.7), (5.8, -1.7)):
        parts += planter(spot, (0.62, 0.36, 0.26))
    return Place(body, parts)


def plaza(rng: np.random.Generator | None = None) -> Place:
    """An open square with bollards, lamps, a stall and house fronts; the place of the built-in references.

    ``rng`` draws another person and shifts the bollards.
    """
    walker = Body(
        height=1.64,
        girth=0.9,
        stride=0.28,
        swing=(-0.35, 0.4),
        elbow=(0.2, 0.7),
        skin=(0.68, 0.47, 0.36),
        hair=(0.45, 0.28, 0.12),
        jacket=(0.20, 0.42, 0.46),
        trousers=(0.30, 0.27, 0.24),
    )
    paving = checker((0.58, 0.57, 0.56), (0.42, 0.43, 0.45), 0.8)
    parts = [
        Part(Panel((-8.0, -8.0, 0), (20.0, 0, 0), (0, 16.0, 0)), paving, 0.2),
        *_house((-8.2, -9.0), (-6.4, -3.2), 6.0, (0.80, 0.55, 0.42), 0.18),
        *_house((-9.8, -3.2), (-8.0, 2.4), 7.0, (0.84, 0.76, 0.56), 0.18),
        *_house((-8.2, 2.4), (-6.4, 9.0), 5.4, (0.58, 0.66, 0.66), 0.18),
        *_house((-8.0, 8.0), (12.0, 9.4), 5.0, (0.76, 0.68, 0.62)),
        *_house((-8.0, -9.4), (12.0, -8.0), 5.6, (0.68, 0.58, 0.54)),
        *_house((12.0, -9.0), (13.0, 9.0), 4.6, (0.72, 0.70, 0.66)),
        *surroundings(),
        *_stall((-4.4, 1.6)),
    ]
    for spot in ((-3.0, -3.2), (-5.4, -0.8), (2.6, -3.4), (2.2, 4.2)):
        parts += _lamp(spot)
    for spot in drawn_spots(rng, (1.15, -0.75), (0.75, 1.35), (2.3, -1.1), (1.9, 2.4), (4.0, -1.5), (3.4, 4.0)):
        parts += _bollard(spot)
    for spot in ((-3.2, 0.4), (5.0, 5.6)):
        parts += planter(spot, (0.42, 0.44, 0.46))
    parts += tree((-5.6, -5.4), 1.2, (0.34, 0.46, 0.18)) + tree((-1.8, 5.4), 1.0, (0.46, 0.42, 0.14))
    return Place(walker if rng is None else drawn_body(rng), parts, axes=MINUS_Y_UP)


def surroundings() -> list[Part]:
    """Coarse earth, towers beyond the walls and a sky dome, so that every ray ends somewhere."""
    sky = Lathe((0, 0, 0), (0, 0, 40), [(np.sin(a), 40 * np.cos(a)) for a in np.linspace(-0.03, np.pi / 2, 20)])
    parts = [
        Part(sky, fade((0.86, 0.89, 0.92), (0.42, 0.60, 0.82), 26), 2.0, lit=False),
    ]
    towers = (((-19, -9), (-14, -5), 11.0), ((-24, 1), (-19, 6), 14.0), ((-17, 9), (-13, 13), 9.0))
    # a frame of earth round the set: large cells under it would shine through the fine paving
    for corner, along, across in (
        ((-42, -42), (84, 0, 0), (0, 33, 0)), ((-42, 10), (84, 0, 0), (0, 32, 0)),
        ((-42, -9), (33, 0, 0), (0, 19, 0)), ((14, -9), (28, 0, 0), (0, 19, 0)),
    ):  # fmt: skip
        parts.append(Part(Panel((*corner, -0.02), along, across), plain((0.46, 0.45, 0.40)), 2.0))
    for low, high, rise in towers:
        parts += _house(low, high, rise, (0.62, 0.60, 0.62), 0.7)
    return parts


def _house(low: Spot, high: Spot, rise: float, color: RGB, spacing: float = 0.32) -> list[Part]:
    front = openings(bricks(color, (1.2, 0.4)), (0.20, 0.24, 0.30), 1.8, 0.8, (1.0, 2.1))

    def storeys(uv: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return front(np.stack([uv[:, 0], np.mod(uv[:, 1], 2.9)], 1), rng)

    *walls, roof = box((*low, 0.0), (*high, rise))
    return [
        *(Part(wall, storeys, spacing) for wall in walls),
        Part(roof, plain((0.50, 0.34, 0.28)), 2 * spacing),
    ]


def _column(spot: Spot) -> list[Part]:
    profile = [(0, 0.30), (0.08, 0.30), (0.09, 0.20), (0.9, 0.17), (0.91, 0.28), (1, 0.28)]
    return [Part(Lathe((*spot, 0), (*spot, 2.7), profile), plain((0.84, 0.79, 0.70)), 0.1)]


def _fountain(spot: Spot) -> list[Part]:
    rim = [(0, 1.15), (0.22, 1.15), (0.22, 1.0), (0.18, 1.0), (0.18, 0.14), (0.6, 0.12)]
    jet = [(0.68, 0.55), (0.70, 0.55), (0.67, 0.10), (0.95, 0.07), (1, 0.0)]
    water = Lathe((*spot, 0.36), (*spot, 0.362), [(0, 1.0), (1, 0.12)])
    return [
        Part(Lathe((*spot, 0), (*spot, 1.9), rim + jet), plain((0.78, 0.76, 0.72), 0.06), 0.09),
        Part(water, plain((0.34, 0.56, 0.64), 0.08), 0.11),
    ]


def tree(spot: Spot, size: float, leaf: RGB) -> list[Part]:
    """A trunk and a crown of five balls, about 3.8 ``size`` [m] tall."""
    x, y = spot
    crown = (
        (0, 0, 2.6, 0.9),
        (0.6, 0.2, 2.3, 0.65),
        (-0.5, 0.4, 2.4, 0.7),
        (0.1, -0.6, 2.25, 0.65),
        (0, 0.1, 3.2, 0.6),
    )
    parts = [Part(capsule((x, y, 0), (x, y, 2.2 * size), 0.13, 0.09), plain((0.34, 0.26, 0.20), 0.1), 0.09)]
    for dx, dy, z, radius in crown:
        middle = (x + dx * size, y + dy * size, z * size)
        parts.append(Part(ball(middle, radius * size, tall=0.85), plain(leaf, 0.22), 0.15, rough=0.12))
    return parts


def planter(spot: Spot, clay: RGB) -> list[Part]:
    """A pot of 0.4 m with flowers in it."""
    pot = [(0, 0.16), (0.9, 0.24), (0.9, 0.27), (1, 0.27), (1, 0.0)]
    parts = [Part(Lathe((*spot, 0), (*spot, 0.42), pot), plain(clay, 0.05), 0.05)]
    for dx, dy, z, radius in ((0, 0, 0.62, 0.24), (0.12, 0.08, 0.55, 0.17), (-0.1, -0.1, 0.56, 0.18)):
        middle = (spot[0] + dx, spot[1] + dy, z)
        parts.append(Part(ball(middle, radius), plain((0.30, 0.50, 0.22), 0.25), 0.06, rough=0.05))
    parts += [
        Part(ball((spot[0] + dx, spot[1] + dy, z), 0.05), plain((0.86, 0.36, 0.40), 0.1), 0.03)
        for dx, dy, z in ((0.17, 0.1, 0.72), (-0.05, -0.2, 0.70), (0.1, -0.1, 0.84), (-0.15, 0.1, 0.78))
    ]
    return parts


def _bollard(spot: Spot) -> list[Part]:
    profile = [(0, 0.13), (0.08, 0.13), (0.1, 0.09), (0.8, 0.08), (0.82, 0.11), (0.9, 0.11), (1, 0)]
    paint = plain((0.24, 0.27, 0.30), 0.05)
    return [Part(Lathe((*spot, 0), (*spot, 0.85), profile), paint, 0.05)]


def _lamp(spot: Spot) -> list[Part]:
    x, y = spot
    profile = [(0, 0.14), (0.12, 0.12), (0.14, 0.06), (0.95, 0.045), (1, 0.09)]
    return [
        Part(Lathe((x, y, 0), (x, y, 3.2), profile), plain((0.18, 0.20, 0.22)), 0.06),
        Part(ball((x, y, 3.42), 0.2, tall=1.2), plain((0.98, 0.93, 0.80), 0.01), 0.09),
    ]


def _stall(spot: Spot) -> list[Part]:
    x, y = spot
    wood, cloth = (
        bricks((0.56, 0.40, 0.26), (2.2, 0.19)),
        stripes((0.80, 0.22, 0.20), (0.93, 0.91, 0.86), 0.3),
    )
    awning = Panel((x - 0.1, y - 0.1, 2.5), (0, 2.4, 0), (1.5, 0, -0.45))
    parts = [Part(panel, wood, 0.1) for panel in box((x, y, 0.0), (x + 1.0, y + 2.2, 0.95))]
    parts.append(Part(awning, cloth, 0.1))
    for end in (y, y + 2.2):
        post = capsule((x + 1.2, end, 0), (x + 1.2, end, 2.2), 0.04, 0.04)
        parts.append(Part(post, plain((0.5, 0.4, 0.3)), 0.07))
    for k, color in enumerate(((0.86, 0.52, 0.16), (0.72, 0.18, 0.16), (0.48, 0.62, 0.20))):
        heap = ball((x + 0.6, y + 0.45 + 0.65 * k, 1.0), 0.24, tall=0.5)
        parts.append(Part(heap, plain(color, 0.15), 0.06, rough=0.03))
    return parts
