"""Whether what is to be described is a camera path alone, which needs no picture to be read."""

from __future__ import annotations

from pathlib import Path

from ..reading.scene_source import is_scene
from ..storage.run_files import TRAJECTORY


def camera_path(source: str) -> Path | None:
    """The file of the camera path that ``source`` names, by itself or as a run; None of anything else."""
    path = Path(source)
    if (path / TRAJECTORY).is_file():
        return path / TRAJECTORY
    return path if path.suffix == ".json" and not is_scene(source) else None
