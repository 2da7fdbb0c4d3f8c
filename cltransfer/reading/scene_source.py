"""How a scene with a trajectory is named: SCENE@TRAJECTORY.json, where either's own name may hold an @ too."""

from __future__ import annotations

import os
from pathlib import Path

from ..registry.declared import BUILTIN

MARKS = 64  # @ that are tried, the last ones: a file that anybody has written may hold any number of them


def split_scene(source: str, folder: Path = Path()) -> tuple[str, str] | None:
    """Scene and trajectory of ``SCENE@TRAJECTORY.json``; None of anything else, such as a file with an @ in its name.

    Of several @ the one counts on whose sides there are a scene and a file, or else a scene; of none such the last.

    Args:
        source: as it is written.
        folder: in which relative names lie.

    >>> split_scene("builtin:plaza@takes@night/shot.json")
    ('builtin:plaza', 'takes@night/shot.json')
    >>> split_scene("takes@night/clip.mp4#t=1,2")
    """
    if source.startswith(BUILTIN):
        scene, at, path = source.partition("@")
        return (scene, path) if at else None
    if "@" not in source or not source.endswith(".json") or os.path.exists(folder / source):
        return None
    marks = [i for i in range(1, len(source)) if source[i] == "@"][-MARKS:]
    splits = [(source[:i], source[i + 1 :]) for i in reversed(marks)]
    known = [split for split in splits if _is_there(folder, split[0])] or splits
    return next((split for split in known if os.path.exists(folder / split[1])), known[0] if known else None)


def is_scene(source: str) -> bool:
    """Whether a reference is a scene with a trajectory, and not a clip or a feature file."""
    return source.startswith(BUILTIN) or split_scene(source) is not None


def _is_there(folder: Path, scene: str) -> bool:
    file = scene.rpartition("#")[0]  # man.glb#t=0.6
    return os.path.exists(folder / scene) or (file != "" and os.path.exists(folder / file))
