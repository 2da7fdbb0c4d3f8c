"""References without end: a canonical shot, its person and where it stands drawn by the trial's seed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..registry.declared import BUILTIN
from ..scenes.load import load_scene
from ..shots import Setup, shot
from .read import DRAWN
from .sweep import Sweep

SIZE = (640, 360)  # [px]
FRAMES = 24  # where a row takes all there are
DRAWN_REFERENCES = "references"  # folder of them in that of the ablation


def draw_references(sweep: Sweep, folder: Path) -> dict[tuple[str, int], str]:
    """Write the trajectory of every ``drawn:SHOT`` and seed; references as SCENE@TRAJECTORY by name and seed.

    Each has the most frames that a row asks for; a row that asks for fewer takes some of them.

    Raises:
        UsageError: there is no such shot.
    """
    made, frames = {}, max(row.config.frames or FRAMES for row in sweep.rows)
    for seed in sweep.file.seeds:
        for reference in sweep.file.references:
            if reference.startswith(DRAWN):
                name = reference.removeprefix(DRAWN)
                scene = f"{BUILTIN}plaza-{seed}"
                person = load_scene(scene).person
                # by its frames too: another sweep in this folder is not to change what this one's trials will read
                path = folder.resolve() / DRAWN_REFERENCES / f"{name}-{seed}-{frames}.json"
                shot(name, person, SIZE, frames, setup=drawn_setup(name, seed)).save(path)
                made[reference, seed] = f"{scene}@{path}"
    return made


def drawn_setup(name: str, seed: int) -> Setup:
    """Where shot ``name`` stands for ``seed``."""
    rng = np.random.Generator(np.random.PCG64([seed, *name.encode()]))
    return Setup.drawn(rng, seed)
