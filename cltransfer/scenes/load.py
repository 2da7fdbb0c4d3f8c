"""A scene by its path."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from ..errors import InputError, UsageError
from ..files import content_hash
from . import Scene

BUILTIN = "builtin:"
FOREIGN_SPLATS = (".spz", ".sog", ".ksplat")
SPLAT_UP = (
    0.0,
    -1.0,
    0.0,
)  # what trainers of splats mostly leave behind: COLMAP's first camera stood upright


def load_scene(path: str | Path, up: tuple[float, float, float] | None = None) -> Scene:
    """Read a scene; its subject is not lifted yet, except in built-in scenes.

    Args:
        path: a Gaussian-splat ``.ply`` or ``.splat``, a voxel grid ``.safetensors``, or ``builtin:NAME``.
        up: upwards in the scene, any length > 0; None is (0, -1, 0) for files and what a built-in scene says.

    Raises:
        InputError: the file is missing, damaged or of no known kind.
        UsageError: ``up`` has no direction, or there is no such built-in scene.
    """
    if str(path).startswith(BUILTIN):
        from .builtin import builtin_scene

        scene = builtin_scene(str(path).removeprefix(BUILTIN))
        if up is not None and not torch.allclose(_unit(up), scene.up):
            raise UsageError(str(path), "up", f"is {tuple(scene.up.tolist())} in this scene; leave it out")
        return scene
    path = Path(path)
    return Scene(_geometry(path), None, _unit(up or SPLAT_UP), path.stem, content_hash(path))


def _geometry(path: Path) -> Any:
    suffix = path.suffix.lower()
    if suffix == ".ply":
        from .ply import read_splats

        return read_splats(path)
    if suffix == ".safetensors":
        from .nerf_grid import read_grid

        return read_grid(path)
    if suffix == ".splat":
        from .dot_splat import read_dot_splat

        return read_dot_splat(path)
    if suffix in FOREIGN_SPLATS:
        raise InputError(path, "", f"{suffix} is not read", f"convert it: splat-transform {path.name} {path.stem}.ply")
    raise InputError(
        path, "", f"no scene has the suffix {path.suffix!r}", "expected .ply, .safetensors or builtin:NAME"
    )


def _unit(vector: tuple[float, float, float]) -> Tensor:
    length = math.hypot(*vector)
    if not (math.isfinite(length) and length > 0):
        raise UsageError("", "up", f"expected a direction, got {vector}")
    return torch.tensor(vector, dtype=torch.float64) / length
