"""What a process pays once, loading and compiling, paid before anything is timed: it is no method's."""

from __future__ import annotations

from functools import cache

from ..transfer import Inputs, transfer
from .methods import config_of, renderer_override

BOTH_ENGINES = ((), ("engine=cma", "generations=1"))


def warm_up(scene: str) -> None:
    """Make ready what teaches a clip to a built-in scene of this form (splats, mesh, grid): once in a process."""
    form = scene.rpartition("-")[2]
    _warmed(f"room-0-{form}" if renderer_override(scene) else "room-0")


@cache
def _warmed(pupil: str) -> None:
    for options in BOTH_ENGINES:
        transfer(Inputs(f"builtin:{pupil}", "builtin:dolly_zoom"), config_of("fast", pupil, 0, ("frames=2", *options)))
