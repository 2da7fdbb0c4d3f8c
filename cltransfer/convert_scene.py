"""From a scene file to another: `cltransfer simplify` and `cltransfer bake`, with what a person reads of them."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from torch import Tensor

from .camera import Camera, fitted_size, in_one_frame
from .errors import InputError, UsageError
from .progress import Progress, silent
from .scenes.bake import bake_grid, bake_splats, surface_area
from .scenes.floaters import without_floaters
from .scenes.load import load_scene
from .scenes.meshes.compose import part_files
from .scenes.meshes.mesh import Mesh
from .scenes.nerf_grid import FORMAT as GRID
from .scenes.nerf_grid import write_grid
from .scenes.person.lifted import save_labels
from .scenes.ply import write_splats
from .scenes.posed import named_camera, read_posed
from .scenes.simplify import importance, merged, subset, weighing_views
from .scenes.splats import Splats
from .storage.files import check_out_file, read_json, same_file
from .storage.foreign import refuse_foreign
from .storage.run_files import SUBJECT, is_run
from .subject import Subject
from .trajectory import FORMAT, Trajectory

Representation = Literal["gaussian_splats", "nerf_grid"]

MARKS = {  # of what was baked: splats without normals, which no mesh is and few trainers write, and grids
    ".ply": "property float z\nproperty float f_dc_0\n",
    ".safetensors": GRID,
}

_log = logging.getLogger("cltransfer")


@dataclass(frozen=True)
class Simplification:
    """How far a scene is simplified.

    Args:
        floaters: drop leaves out Gaussians that hang in the air by themselves; that needs no view.
        k: voxels whose Gaussians are merged, in pixels of the nearest view; 0 merges nothing.
        prune: Gaussians that have a smaller share of every pixel of every view are left out, in [0, 1].
        side: longer side of the frames that the scene is to be seen at [px].

    Raises:
        ValueError: an option is out of range.
    """

    floaters: Literal["keep", "drop"] = "keep"
    k: float = 2.0
    prune: float = 0.0
    side: int = 160

    def __post_init__(self) -> None:
        if not 0 <= self.k <= 64:
            raise ValueError(f"k must be in [0, 64], got {self.k}")
        if not 0 <= self.prune <= 1:
            raise ValueError(f"prune must be in [0, 1], got {self.prune}")
        if not 16 <= self.side <= 4096:
            raise ValueError(f"side must be in [16, 4096], got {self.side}")


def given_views(sources: Sequence[str], side: int) -> Camera:
    """Views (B) of trajectory files and posed image sets (``SET:INDEX``, or ``SET`` for all), in one frame.

    Each has ``side`` pixels along its longer side; the frame holds the widest and the highest.

    Raises:
        InputError: one of them cannot be read.
        UsageError: there is none, or a set has no such camera.
    """
    if not sources:
        raise UsageError("", "--view", "expected at least one", "a trajectory.json, SET:INDEX, or SET")
    cameras = [camera for source in sources for camera in _views(source)]
    return in_one_frame(cameras, [fitted_size(camera.size, side) for camera in cameras])


def _views(source: str) -> list[Camera]:
    """What one source names, those of a set each at its own size."""
    camera = named_camera(source, "--view")
    if camera is not None:
        return [camera]
    path = Path(source)
    if _is_trajectory(path) or is_run(path):  # of a run's folder the error tells which file
        return [Trajectory.load(path).camera]
    posed = read_posed(path)
    return [posed.whole(index) for index in range(len(posed))]


def _is_trajectory(path: Path) -> bool:
    """Whether a file is JSON that calls itself one; of what is no JSON object only the start is read."""
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        if not stream.read(64).lstrip().startswith(b"{"):
            return False
    return bool(read_json(path).get("format") == FORMAT)


def simplify_file(
    source: str, out: Path, views: Sequence[str], options: Simplification, progress: Progress = silent
) -> Mapping[str, Any]:
    """Write the Gaussians of ``source`` that ``views`` need to ``out``; returns how many were left by each step.

    What is done is told to ``progress``.

    Raises:
        UsageError: the scene is not made of splats, or ``out`` is no .ply.
        ResourceError: there is not enough memory to simplify it.
    """
    if out.suffix.lower() != ".ply":
        raise UsageError(out, "--out", "expected a .ply file")
    check_out_file(out)
    _refuse_source(out, source)
    progress("reading the scene", 0, 0)
    scene = load_scene(source)
    if not isinstance(scene.geometry, Splats):
        kind = type(scene.geometry).__name__
        raise UsageError(source, "scene", f"expected Gaussian splats, got {kind}", "only these can be simplified")
    unseen = options.floaters == "drop" and options.k == options.prune == 0 and not views
    cameras = None if unseen else given_views(views, options.side)
    splats: Splats = scene.geometry
    if options.floaters == "drop":
        progress("leaving out floaters", 0, 0)
        splats = without_floaters(scene).geometry
    solid = len(splats)
    if cameras is not None and options.prune > 0:
        progress("pruning", 0, 0)
        splats = subset(splats, importance(splats, weighing_views(splats, cameras)) >= options.prune)
    pruned = len(splats)
    if cameras is not None and options.k > 0 and pruned:
        progress("merging", 0, 0)
        splats = merged(splats, cameras, options.k)
    if len(splats) == 0:
        raise InputError(source, "prune", "leaves no Gaussian", "is the scene in the views?")
    write_splats(out, splats, z_up=scene.up.tolist() == [0, 0, 1])
    counts = {"before": len(scene.geometry), "solid": solid, "pruned": pruned, "after": len(splats)}
    return {"file": str(out), **counts}


def bake_to_folder(
    source: str, out: Path, representation: Representation, detail: int | None, progress: Progress = silent
) -> Mapping[str, Any]:
    """Bake the mesh ``source`` into ``out``: the scene, and its person's subject.json and labels where known.

    A person who is marked but has no skeleton is told of: nothing baked keeps the mark.

    Args:
        source: a mesh, or a composition of meshes.
        out: folder.
        representation: what to make of it.
        detail: Gaussians in all, or cells along the longest side; None is what the representation usually needs.
        progress: is told what is done.

    Raises:
        UsageError: the scene is not a mesh, or a file that was not baked here would be replaced.
        InputError: it cannot be read, or has no area.
        ResourceError: what is to be made of it takes more memory than is free.
    """
    progress("reading the mesh", 0, 0)
    scene = load_scene(source)
    if not isinstance(scene.geometry, Mesh):
        kind = type(scene.geometry).__name__
        raise UsageError(source, "scene", f"expected a mesh, got {kind}", "only meshes can be baked")
    mesh: Mesh = scene.geometry
    if not surface_area(mesh) > 0:
        raise InputError(source, "faces", f"expected an area, got {len(mesh)} faces without one")
    file = out / f"{scene.name}{'.ply' if representation == 'gaussian_splats' else '.safetensors'}"
    _refuse_source(file, source, part_files(Path(source)) if source.lower().endswith((".yaml", ".yml")) else ())
    refuse_foreign(out, {file.name: MARKS[file.suffix]})
    progress("baking", 0, 0)
    if representation == "gaussian_splats":
        splats = bake_splats(mesh, *([] if detail is None else [detail]))
        count, label = len(splats), splats.label
        _refuse_nothing(source, count)
        write_splats(file, splats)
    else:
        grid = bake_grid(mesh, *([] if detail is None else [detail]))
        count, label = len(grid), grid.label[tuple(grid.filled.T)]
        _refuse_nothing(source, count)
        write_grid(file, grid)
    if scene.subject is not None:
        _write_person(out, scene.subject, label)
    elif bool(mesh.label.any()):  # labels are read beside a subject.json only
        _log.warning("%s: marks a person without a skeleton, whom what is baked does not: lift %s", source, file)
    return {"file": str(file), "count": count, "up": scene.up.tolist(), "subject": scene.subject is not None}


def _refuse_nothing(source: str, count: int) -> None:
    if count == 0:
        raise InputError(source, "faces", "expected something to be seen, all of it is transparent")


def _refuse_source(out: Path, source: str, parts: Sequence[Path] = ()) -> None:
    """Refuse to write over what was read, the ``source`` and its ``parts``, which is lost then."""
    for read, what in ((Path(source), "the scene itself"), *((part, "a part of the scene") for part in parts)):
        if out.exists() and same_file(out, read):
            raise UsageError(out, "--out", f"is {what}", "name another one")


def _write_person(folder: Path, subject: Subject, label: Tensor) -> None:
    subject.save(folder / SUBJECT)
    save_labels(folder, label)
