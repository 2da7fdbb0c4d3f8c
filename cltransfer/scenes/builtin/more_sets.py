"""Three places whose person and furniture are drawn: two indoors, one outdoors.

The camera side is +x, as in the other sets. Indoors the ceiling casts no shadow: light falls in as through a skylight.
"""

from __future__ import annotations

import numpy as np

from .drawn import drawn_body, drawn_spots
from .paint import RGB, Part, bricks, checker, openings, plain, stripes
from .place import MINUS_Y_UP, Y_UP, Place, Spot, bystander
from .sets import planter, surroundings, tree
from .surfaces import Lathe, Panel, ball, box, capsule

_WOOD: RGB = (0.52, 0.36, 0.24)
_HIGH = (0.25, 0.18, 0.95)  # direction to the light indoors


def room(rng: np.random.Generator) -> Place:
    """A loft with windows, shelves, a sofa, a table, lamps and stools."""
    wall = plain((0.80, 0.77, 0.70), 0.05)
    boards, brickwork = bricks((0.56, 0.42, 0.30), (1.6, 0.2)), bricks((0.62, 0.36, 0.28), (0.44, 0.16))
    panes = openings(wall, (0.86, 0.92, 0.97), 2.2, 1.3, (0.9, 2.5))
    parts = [
        Part(Panel((-4.5, -7.0, 0), (15.5, 0, 0), (0, 14.0, 0)), boards, 0.2),
        Part(Panel((-4.5, -7.0, 0), (0, 14.0, 0), (0, 0, 4.4)), brickwork, 0.16),
        Part(Panel((11.0, 7.0, 0), (0, -14.0, 0), (0, 0, 4.4)), wall, 0.4),
        Part(Panel((-4.5, 7.0, 0), (15.5, 0, 0), (0, 0, 4.4)), panes, 0.22),
        Part(Panel((11.0, -7.0, 0), (-15.5, 0, 0), (0, 0, 4.4)), wall, 0.3),
        Part(
            Panel((-4.5, -7.0, 4.4), (0, 14.0, 0), (15.5, 0, 0)),
            stripes((0.72, 0.70, 0.66), _WOOD, 0.5),
            0.5,
            lit=False,
        ),
        *_shelves((-4.3, float(rng.uniform(-4.5, -1.5))), rng),
        *_sofa((-3.3, float(rng.uniform(0.2, 1.6))), (0.26, 0.36, 0.46)),
        *_table((float(rng.uniform(-1.8, -1.2)), float(rng.uniform(-3.6, -2.6)))),
    ]
    for spot in drawn_spots(rng, (-2.2, 3.6), (1.5, -3.4), (3.2, 4.6)):
        parts += _floor_lamp(spot)
    for spot in drawn_spots(rng, (1.2, -1.0), (0.9, 1.4), (2.6, -1.5), (2.4, 2.3), (4.4, -1.9)):
        parts += _stool(spot)
    parts += planter((-1.4, 1.9), (0.76, 0.74, 0.70)) + planter((3.9, 3.4), (0.76, 0.74, 0.70))
    return Place(drawn_body(rng), parts, sun=_HIGH)


def stage(rng: np.random.Generator) -> Place:
    """A theatre's stage with a curtain, wings, a piano and a second person, seen from rows of seats."""
    boards = bricks((0.40, 0.27, 0.18), (2.0, 0.16))
    velvet, dark = stripes((0.55, 0.10, 0.13), (0.43, 0.07, 0.10), 0.35), plain((0.24, 0.21, 0.23), 0.06)
    parts = [
        Part(Panel((-4.5, -7.0, 0), (7.5, 0, 0), (0, 14.0, 0)), boards, 0.16),
        Part(Panel((3.0, -7.0, -0.9), (0, 14.0, 0), (0, 0, 0.9)), plain(_WOOD), 0.2),
        Part(
            Panel((3.0, -7.0, -0.9), (9.0, 0, 0), (0, 14.0, 0)),
            checker((0.38, 0.22, 0.22), (0.30, 0.17, 0.18), 0.6),
            0.3,
        ),
        Part(Panel((-4.2, -7.0, 0), (0, 14.0, 0), (0, 0, 5.2)), velvet, 0.16),
        Part(Panel((12.0, 7.0, -0.9), (0, -14.0, 0), (0, 0, 6.1)), dark, 0.5),
        Part(
            Panel((-4.5, 7.0, -0.9), (16.5, 0, 0), (0, 0, 6.1)),
            openings(dark, (0.62, 0.50, 0.30), 2.6, 1.2, (1.0, 2.6)),
            0.3,
        ),
        Part(
            Panel((12.0, -7.0, -0.9), (-16.5, 0, 0), (0, 0, 6.1)),
            openings(dark, (0.62, 0.50, 0.30), 2.6, 1.2, (1.0, 2.6)),
            0.3,
        ),
        Part(Panel((-4.5, -7.0, 5.2), (0, 14.0, 0), (16.5, 0, 0)), plain((0.20, 0.18, 0.20), 0.05), 0.6, lit=False),
        *(_wing(side) for side in (-1, 1)),
        *_piano((-2.6, -3.2)),
    ]
    side = float(rng.choice([-1.0, 1.0]))
    parts += bystander(drawn_body(rng), float(rng.uniform(-0.9, 0.9)), (float(rng.uniform(-1.6, -0.5)), 1.5 * side))
    for spot in drawn_spots(rng, (1.3, -1.1), (1.0, 1.6), (2.4, 0.9)):
        parts += _stool(spot)
    for x in (4.6, 6.0, 7.4, 8.8):
        for y in np.arange(-4.2, 4.3, 1.4):
            parts += _seat((x, float(y)))
    return Place(drawn_body(rng), parts, axes=MINUS_Y_UP, sun=_HIGH, people=2)


def path(rng: np.random.Generator) -> Place:
    """A gravel path through a park: trees along it, hedges, a bench, posts with lanterns, hills far off."""
    grass, gravel = plain((0.36, 0.48, 0.22), 0.16), plain((0.68, 0.62, 0.52), 0.10)
    parts = [
        Part(Panel((-9.0, -1.5, 0), (23.0, 0, 0), (0, 3.0, 0)), gravel, 0.15),
        Part(Panel((-9.0, -9.0, -0.01), (23.0, 0, 0), (0, 7.5, 0)), grass, 0.28),
        Part(Panel((-9.0, 1.5, -0.01), (23.0, 0, 0), (0, 8.5, 0)), grass, 0.28),
        *surroundings(),
        *_bench((-2.2, 2.0)),
    ]
    for low, high in (
        ((-9.0, -8.9), (14.0, -8.0)),
        ((-9.0, 8.6), (14.0, 9.5)),
        ((-9.0, -8.0), (-8.2, -1.8)),
        ((-9.0, 1.8), (-8.2, 8.6)),
    ):
        parts += [Part(p, plain((0.22, 0.38, 0.18), 0.25), 0.3, rough=0.06) for p in box((*low, 0.0), (*high, 2.4))]
    trees = ((-3.4, -2.9), (-6.2, -2.6), (-5.0, 3.2), (-1.2, 4.4), (1.8, -4.6), (4.6, 4.4), (6.8, -4.4), (-7.4, 4.8))
    for spot in drawn_spots(rng, *trees, reach=0.5):
        leaf = (float(rng.uniform(0.24, 0.56)), float(rng.uniform(0.36, 0.50)), float(rng.uniform(0.12, 0.22)))
        parts += tree(spot, float(rng.uniform(0.85, 1.3)), leaf)
    for spot in drawn_spots(rng, (1.3, -1.25), (0.9, 1.5), (2.7, -1.6), (2.5, 2.6), (4.6, -1.8)):
        parts += _bush(spot, rng)
    for spot in ((-4.2, 1.7), (3.4, -2.2)):
        parts += _floor_lamp(spot)
    return Place(drawn_body(rng), parts, axes=Y_UP)


def _block(low: Spot, size: Spot, levels: tuple[float, float], color: RGB, spacing: float = 0.09) -> list[Part]:
    """A block over the floor's rectangle ``low``, ``size`` [m] between two heights."""
    sides = box((*low, levels[0]), (low[0] + size[0], low[1] + size[1], levels[1]))
    return [Part(side, plain(color, 0.05), spacing) for side in sides]


def _shelves(spot: Spot, rng: np.random.Generator) -> list[Part]:
    x, y = spot
    parts = [part for z in (0.4, 0.9, 1.4, 1.9) for part in _block((x, y), (0.4, 2.6), (z, z + 0.05), _WOOD)]
    parts += [part for end in (y - 0.06, y + 2.6) for part in _block((x, end), (0.4, 0.06), (0.0, 2.2), _WOOD)]
    for z in (0.45, 0.95, 1.45):
        for place in np.arange(y + 0.05, y + 2.45, 0.3):
            red, green, blue = (float(c) for c in rng.uniform(0.15, 0.8, 3))
            parts += _block(
                (x + 0.05, float(place)), (0.24, 0.2), (z, z + float(rng.uniform(0.2, 0.36))), (red, green, blue), 0.08
            )
    return parts


def _sofa(spot: Spot, color: RGB) -> list[Part]:
    x, y = spot
    parts = _block((x, y), (0.9, 2.2), (0.0, 0.45), color) + _block((x, y), (0.25, 2.2), (0.45, 0.95), color)
    return parts + [p for end in (y - 0.2, y + 2.2) for p in _block((x, end), (0.9, 0.2), (0.0, 0.65), color)]


def _table(spot: Spot) -> list[Part]:
    x, y = spot
    parts = _block((x, y), (1.5, 0.8), (0.70, 0.75), _WOOD)
    for dx in (0.06, 1.44):
        for dy in (0.06, 0.74):
            leg = capsule((x + dx, y + dy, 0), (x + dx, y + dy, 0.7), 0.03, 0.03)
            parts.append(Part(leg, plain(_WOOD), 0.06))
    bowl = ball((x + 0.7, y + 0.4, 0.84), 0.16, tall=0.6)
    return [*parts, Part(bowl, plain((0.82, 0.56, 0.20), 0.12), 0.05)]


def _stool(spot: Spot) -> list[Part]:
    profile = [(0, 0.16), (0.06, 0.16), (0.08, 0.04), (0.85, 0.04), (0.87, 0.19), (1, 0.19), (1, 0)]
    return [Part(Lathe((*spot, 0), (*spot, 0.62), profile), plain((0.30, 0.28, 0.27), 0.05), 0.05)]


def _floor_lamp(spot: Spot) -> list[Part]:
    profile = [(0, 0.16), (0.02, 0.16), (0.03, 0.025), (1, 0.025)]
    shade = [(0, 0.24), (1, 0.16)]
    return [
        Part(Lathe((*spot, 0), (*spot, 1.75), profile), plain((0.18, 0.18, 0.18)), 0.05),
        Part(Lathe((*spot, 1.7), (*spot, 2.05), shade), plain((0.97, 0.90, 0.74), 0.02), 0.07),
    ]


def _wing(side: int) -> Part:
    """A curtain that hangs at one side of the stage."""
    cloth = stripes((0.50, 0.09, 0.12), (0.40, 0.06, 0.09), 0.25)
    return Part(Panel((0.4, side * 4.6, 0), (1.2, side * 2.4, 0), (0, 0, 5.0)), cloth, 0.16)


def _piano(spot: Spot) -> list[Part]:
    x, y = spot
    black: RGB = (0.10, 0.10, 0.11)
    parts = _block((x, y), (0.7, 1.5), (0.0, 1.25), black) + _block((x + 0.7, y), (0.3, 1.5), (0.62, 0.72), black)
    keys = Panel((x + 0.72, y + 0.1, 0.73), (0.15, 0, 0), (0, 1.3, 0))
    return [*parts, Part(keys, plain((0.93, 0.92, 0.88)), 0.05)]


def _seat(spot: Spot) -> list[Part]:
    x, y = spot
    red: RGB = (0.50, 0.14, 0.15)
    back = _block((x + 0.45, y), (0.12, 0.6), (-0.9, 0.05), red, 0.12)
    return back + _block((x, y), (0.45, 0.6), (-0.9, -0.45), red, 0.12)


def _bench(spot: Spot) -> list[Part]:
    x, y = spot
    seat = _block((x, y), (1.6, 0.45), (0.40, 0.46), _WOOD, 0.07)
    back = _block((x, y + 0.42), (1.6, 0.05), (0.55, 0.90), _WOOD, 0.07)
    return (
        seat
        + back
        + [p for dx in (0.1, 1.4) for p in _block((x + dx, y), (0.1, 0.45), (0.0, 0.40), (0.3, 0.3, 0.3), 0.07)]
    )


def _bush(spot: Spot, rng: np.random.Generator) -> list[Part]:
    radius = float(rng.uniform(0.24, 0.36))
    heap = ball((*spot, radius * 0.8), radius, tall=0.9)
    return [Part(heap, plain((0.30, 0.46, 0.20), 0.25), 0.06, rough=0.05)]
