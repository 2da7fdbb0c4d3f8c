"""People and places drawn by a random generator, without end."""

from __future__ import annotations

import numpy as np

from .mannequin import Body
from .paint import RGB
from .place import Spot

_SKIN: tuple[RGB, ...] = ((0.86, 0.66, 0.54), (0.68, 0.47, 0.36), (0.45, 0.30, 0.22), (0.93, 0.76, 0.66))
_HAIR: tuple[RGB, ...] = ((0.20, 0.13, 0.09), (0.45, 0.28, 0.12), (0.10, 0.09, 0.10), (0.62, 0.60, 0.58))
_JACKET: tuple[RGB, ...] = (
    *((0.74, 0.24, 0.18), (0.20, 0.42, 0.46), (0.82, 0.62, 0.22), (0.34, 0.26, 0.48), (0.22, 0.46, 0.26)),
)
_TROUSERS: tuple[RGB, ...] = ((0.20, 0.25, 0.36), (0.30, 0.27, 0.24), (0.14, 0.14, 0.16), (0.44, 0.40, 0.34))


def drawn_body(rng: np.random.Generator) -> Body:
    """A mannequin of some height (1.45 to 1.98 m), build, pose and clothes."""
    skin, hair, jacket, trousers = (
        palette[rng.integers(len(palette))] for palette in (_SKIN, _HAIR, _JACKET, _TROUSERS)
    )
    left, right = rng.uniform(-0.45, 0.45, 2)
    bent = rng.uniform(0.05, 1.2, 2)
    return Body(
        height=float(rng.uniform(1.45, 1.98)),
        girth=float(rng.uniform(0.84, 1.28)),
        stride=float(rng.uniform(-0.32, 0.32)),
        swing=(float(left), float(right)),
        spread=float(rng.uniform(0.08, 0.30)),
        elbow=(float(bent[0]), float(bent[1])),
        skin=skin,
        hair=hair,
        jacket=jacket,
        trousers=trousers,
    )


def drawn_spots(rng: np.random.Generator | None, *spots: Spot, reach: float = 0.3) -> list[Spot]:
    """The spots, each moved by up to ``reach`` [m] along either axis; as they are without ``rng``."""
    moves = np.zeros((len(spots), 2)) if rng is None else rng.uniform(-reach, reach, (len(spots), 2))
    return [(x + float(dx), y + float(dy)) for (x, y), (dx, dy) in zip(spots, moves)]
