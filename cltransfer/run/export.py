"""A path as a camera of other programs."""

from __future__ import annotations

import os
from pathlib import Path

from ..errors import InputError, UsageError
from ..export.blender import write_blender
from ..export.colmap import write_colmap
from ..export.nerfstudio import write_camera_path
from ..export.usd import write_usd
from ..storage.files import check_out, check_out_file, read_json
from ..storage.run_files import MANIFEST, RESULTS, TRAJECTORY, is_run, require_done
from ..trajectory import Trajectory
from .frame_rate import at_rate

TURNED = (".glb", ".gltf", ".obj", ".yaml", ".yml")  # scenes, or their parts, whose y other programs take for up


def export_path(source: Path, out: Path, fps: float | None, y_up: bool | None) -> Trajectory:
    """Write the path of ``source`` as what the name of ``out`` says; returns the cameras that were written.

    Args:
        source: folder of a run, or a ``trajectory.json``.
        out: ``.usda``, ``.py`` (Blender), ``.json`` (nerfstudio), or a folder (COLMAP).
        fps: frames a second, the camera led smoothly through those that the path has; None: only those.
        y_up: whether other programs turn the scene's file, as they do glTF and OBJ; None: where that of the run is of
            :data:`TURNED`, and not of a trajectory alone.

    Raises:
        UsageError: ``out`` has another ending, or is what a run has written itself; ``fps`` is out of range.
        InputError: ``source`` is no such thing, a run that was not finished, or the format has no room for its lens.
    """
    _check_out(out, source)
    run = source.is_dir()
    if run:
        if not is_run(source):
            raise InputError(source, MANIFEST, "no such file", "expected the folder of a run, or a trajectory.json")
        require_done(source)
    trajectory = at_rate(Trajectory.load(source / TRAJECTORY if run else source), fps)
    turned = _turned(source) if y_up is None and run else bool(y_up)
    if out.suffix == ".usda":
        write_usd(out, trajectory, turned)
    elif out.suffix == ".py":
        write_blender(out, trajectory, turned)
    elif out.suffix == ".json":
        write_camera_path(out, trajectory)
    else:
        write_colmap(out, trajectory)
    return trajectory


def _turned(run: Path) -> bool:
    """Whether other programs turn the scene of a run.

    Raises:
        InputError: its manifest does not tell of which file that is.
    """
    try:
        return str(read_json(run / MANIFEST)["scene"]["file"]) in TURNED
    except (KeyError, TypeError):
        raise InputError(run / MANIFEST, "scene", "expected file", "say --y-up or --no-y-up") from None


def _check_out(out: Path, source: Path) -> None:
    if out.suffix not in (".usda", ".py", ".json", ""):
        expected = "expected a name that ends in .usda, .py (Blender), .json (nerfstudio), or a folder (COLMAP)"
        raise UsageError(out, "--out", expected)
    check_out_file(out) if out.suffix else check_out(out)
    kept = [source, *(folder / name for folder in (source, *out.parents[:2]) for name in RESULTS if is_run(folder))]
    if os.path.realpath(out) in map(os.path.realpath, kept):
        raise UsageError(out, "--out", "is a file of the run itself, or what is read", "name another")
