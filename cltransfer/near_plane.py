"""How near to a camera a renderer draws a scene whole, and which of its options bring that nearer."""

from __future__ import annotations

import math
from typing import Any

from .registry import RENDERERS

NEAR, FADE = "near", "near_fade"  # options of a renderer: nothing nearer is drawn, and it fades in over this
SHARE = 0.25  # of the distance that lies before the near plane where there is a fade behind it


def drawn_whole(renderer: Any) -> float:
    """Distance [scene units] from which on ``renderer`` draws all there is; 0 where no option of it tells."""
    distances = _distances(renderer)
    return sum(distances.values()) if NEAR in distances else 0.0


def smaller_near(renderer: Any, distance: float) -> str:
    """Options by which ``renderer`` draws whole what is farther than ``distance`` [scene units].

    Empty where it does so already, or has no such option.
    """
    if not 0 < distance < drawn_whole(renderer):
        return ""
    name = RENDERERS.name_of(renderer)
    above = f"{RENDERERS.section}.{name}." if name else ""
    if FADE not in _distances(renderer):
        return f"{above}{NEAR}={_short(distance)}"
    near, fade = near_plane(distance)
    return f"{above}{NEAR}={_short(near)} {above}{FADE}={_short(fade)}"


def near_plane(distance: float) -> tuple[float, float]:
    """Near plane and fade behind it by which all is drawn whole from ``distance`` on, all in scene units."""
    return SHARE * distance, (1 - SHARE) * distance


def _distances(renderer: Any) -> dict[str, float]:
    """Those of the two that are options of ``renderer``, and numbers there: a plugin's may be anything."""
    options = getattr(renderer, "__dataclass_fields__", ())
    values = {name: getattr(renderer, name) for name in (NEAR, FADE) if name in options}
    return {name: float(v) for name, v in values.items() if type(v) in (int, float) and math.isfinite(v)}


def _short(value: float) -> str:
    """A positive number in one digit, rounded down."""
    digit, exponent = f"{value:e}".split("e")
    return f"{float(f'{digit[0]}e{exponent}'):g}"
