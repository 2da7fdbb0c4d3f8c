"""How near to a camera a renderer draws a scene whole, and which of its options bring that nearer."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from .camera import Camera
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


def cut_note(renderer: Any, cameras: Camera, joints: Tensor) -> str:
    """Where a person comes nearer to a camera than what ``renderer`` draws whole, as in a scene whose unit is large.

    Args:
        renderer: that draws the scene.
        cameras: N frames.
        joints: of the person, (J, 3); NaN where unknown.

    Returns:
        In words, with the options that draw the person whole; empty where no frame shows a joint that near.
    """
    pixels, depth = cameras.project(joints)
    shown = ((pixels >= 0) & (pixels < pixels.new_tensor(cameras.size))).all(-1) & (depth > 0)
    nearest = torch.where(shown, depth, torch.inf).amin(1)
    count, least = int((nearest < drawn_whole(renderer)).sum()), float(nearest.min())
    if not count:
        return ""
    where = f"in {count} of {len(cameras)} frames, as near as {least:.2g} scene units"
    return f"the person is faded or cut {where}: set {smaller_near(renderer, least / 2)}"


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
