"""A scene by its path."""

from __future__ import annotations

import hashlib
import logging
import math
import shlex
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from ..errors import InputError, UsageError
from ..registry.declared import BUILTIN, SCENE_SUFFIXES
from ..storage.files import content_hash
from . import Scene
from .foreign import own_suffixes, read_foreign, reader_code, reader_of
from .meshes.moment import START, Moment, split_moment
from .ply_header import has_faces, is_z_up
from .steps import check_steps

FOREIGN_SPLATS = (".sog", ".ksplat")
ANIMATED = (".glb", ".gltf")  # scenes of which a moment may be named
MESH_SUFFIXES = (".glb", ".gltf", ".obj")
SPLAT_UP = (
    0.0,
    -1.0,
    0.0,
)  # what trainers of splats mostly leave behind: COLMAP's first camera stood upright
Z_UP = (0.0, 0.0, 1.0)  # of a splat whose header says so

_log = logging.getLogger("cltransfer")


def load_scene(path: str | Path, up: tuple[float, float, float] | None = None) -> Scene:
    """Read a scene; its subject is not lifted yet, except in built-in scenes and where a mesh's skeleton tells it.

    Args:
        path: a Gaussian-splat ``.ply``, ``.splat`` or ``.spz``, a voxel grid ``.safetensors``, a mesh (``.glb``,
            ``.gltf``, ``.obj``, or a ``.ply`` with faces), a ``.yaml`` that composes meshes, or
            ``builtin:NAME[-SEED[-FORM]]``; or a file that an allowed plugin reads, by its suffix. An animated glTF may
            have its moment behind it: ``man.glb#t=0.6``, ``man.glb#t=2&animation=Run``.
        up: upwards in the scene, any length > 0; None is (0, -1, 0) for splats, grids and what a plugin reads,
            (0, 1, 0) for meshes, and what a built-in scene says; (0, 0, 1) for a splat whose header says that z is
            vertical, as nerfstudio writes it, which is told.

    Raises:
        InputError: the file is missing, damaged, of no known kind, or lies too far from its origin for float32.
        UsageError: ``up`` has no direction, there is no such built-in scene, or the moment is none or of no glTF.
        ModelError: the plugin that reads it fails, or several do.
    """
    if str(path).startswith(BUILTIN):
        from .builtin import named_scene

        scene = named_scene(str(path).removeprefix(BUILTIN))
        if up is not None and not torch.allclose(_unit(up), scene.up):
            raise UsageError(str(path), "up", f"is {tuple(scene.up.tolist())} in this scene; leave it out")
        return scene
    path, moment = split_moment(path)
    suffix = path.suffix.lower()
    if moment is not None and suffix not in ANIMATED:
        raise UsageError(path, f"#{moment}", "only a .glb or .gltf is looked at in time", "in a .yaml write time: ...")
    if suffix in (".yaml", ".yml"):
        from .meshes.compose import read_composed

        return read_composed(path, None if up is None else _components(up))
    if suffix in MESH_SUFFIXES or (suffix == ".ply" and has_faces(path)):
        return _mesh_scene(path, moment, up)
    geometry = _geometry(path)
    check_steps(path, geometry.means)
    upward = _unit(up or _told_up(path))
    return Scene(geometry, None, upward, path.stem, content_hash(path), reader_code(path))


def usual_up(path: Path) -> tuple[float, float, float]:
    """Upwards in splats or a grid of which nobody says it otherwise, by what a splat's header says."""
    return Z_UP if path.suffix.lower() == ".ply" and is_z_up(path) else SPLAT_UP


def _told_up(path: Path) -> tuple[float, float, float]:
    """What is usual, told where it is not that of most."""
    if (up := usual_up(path)) == Z_UP:
        _log.warning("%s: up is taken as 0,0,1, since its header says that z is vertical (otherwise: --up X,Y,Z)", path)
    return up


def _mesh_scene(path: Path, moment: Moment | None, up: tuple[float, float, float] | None) -> Scene:
    from .meshes.read_mesh import UP, read_mesh

    upward = _unit(up or UP)
    found = read_mesh(path, moment or START, _components(up or UP))
    told = [content_hash(file) for file in found.files] + ([] if moment is None else [str(moment)])
    digest = told[0] if len(told) == 1 else hashlib.sha256("".join(told).encode()).hexdigest()
    return Scene(found.mesh, found.subject, upward, path.stem, digest)


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
    if suffix == ".spz":
        from .spz import read_spz

        return read_spz(path)
    if (reader := reader_of(path)) is not None:
        return read_foreign(path, reader)
    if suffix in FOREIGN_SPLATS:
        command = shlex.join(["splat-transform", path.name, f"{path.stem}.ply"])
        raise InputError(path, "", f"{suffix} is not read", f"convert it: {command}")
    if not suffix and not path.exists():
        from .builtin import SETS

        if str(path).partition("-")[0] in SETS:
            raise InputError(path, "", "no such file", f"did you mean {shlex.quote(f'{BUILTIN}{path}')}?")
    known = ", ".join((*SCENE_SUFFIXES, *own_suffixes()))
    if path.is_dir():
        raise InputError(path, "", "is a folder, expected the file of a scene", f"{known} or {BUILTIN}NAME")
    hint = f"expected {known} or builtin:NAME; others by a plugin, in verbs with --allow-plugin"
    raise InputError(path, "", f"no scene has the suffix {path.suffix!r}", hint)


def _components(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    x, y, z = _unit(vector).tolist()
    return x, y, z


def _unit(vector: tuple[float, float, float]) -> Tensor:
    length = math.hypot(*vector)
    if not (math.isfinite(length) and length > 0):
        raise UsageError("", "up", f"expected a direction, got {vector}")
    return torch.tensor(vector, dtype=torch.float64) / length
