"""What a stressor changes, and what a stressor is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from torch import Tensor

from ...camera import Camera
from ...features import Features
from ...scenes import Scene


@dataclass(frozen=True)
class Film:
    """How a reference is shot.

    Args:
        frames: N; a shot does all of its move in them.
        size: (W, H) [px].
    """

    frames: int
    size: tuple[int, int]


@dataclass(frozen=True)
class Case:
    """What a method is given.

    Args:
        reference: N frames as they were read.
        times: (N,) [s].
        scene: where the shot is to be found again; splats with a person.
        view: the first view, (1).
    """

    reference: Features
    times: Tensor  # (N,)
    scene: Scene
    view: Camera


@dataclass(frozen=True)
class Stressor:
    """One way to make a case worse.

    Args:
        what: one line for tables.
        unit: of a level.
        levels: five, from mild to severe.
        strain: the case at a level, with its own random numbers.
        film: the film at a level, for what is done before the camera.
        frames: that a clip has at least: of fewer, two levels would be the same.
    """

    what: str
    unit: str
    levels: tuple[float, float, float, float, float]
    strain: Callable[[Case, float, np.random.Generator], Case] = lambda case, level, rng: case
    film: Callable[[Film, float], Film] = lambda film, level: film
    frames: int = 1
