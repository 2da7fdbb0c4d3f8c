"""Stress by how the reference was shot."""

from __future__ import annotations

from dataclasses import replace

from .case import Film, Stressor


def faster(film: Film, speed: float) -> Film:
    """The same move in fewer frames, two at least: each frame moves ``speed`` times as far."""
    return replace(film, frames=max(2, round(film.frames / speed)))


def reshaped(film: Film, aspect: float) -> Film:
    """The frame ``aspect`` times as wide as high, at the same height."""
    return replace(film, size=(round(film.size[1] * aspect), film.size[1]))


FILMING = {
    "fast_motion": Stressor(
        "the move in fewer frames", "times as fast", (1.5, 2.0, 3.0, 4.0, 6.0), film=faster, frames=12
    ),
    "aspect_ratio": Stressor("a narrower frame", "width / height", (1.33, 1.0, 0.8, 0.5625, 0.4), film=reshaped),
}
