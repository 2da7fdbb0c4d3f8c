"""A path as a camera of other programs."""

from __future__ import annotations

import os
from pathlib import Path

from ..errors import InputError, UsageError
from ..export.blender import write_blender
from ..export.colmap import check_model, write_colmap
from ..export.lens import at_side, filmable, rate_of
from ..export.nerfstudio import write_camera_path
from ..export.usd import write_usd
from ..storage.files import check_out_file, read_json, same_file
from ..storage.foreign import head_holds
from ..storage.run_files import MANIFEST, TRAJECTORY, kept_by_runs, require_done, require_run
from ..trajectory import Trajectory
from .frame_rate import at_rate

TURNED = (".glb", ".gltf", ".obj")  # files whose y other programs take for up
FRAMES = 100_000  # cameras of one file, about 20 MB
WORLDS = (".usda", ".py")  # formats that say, or act on, which way is up
MARKS = {  # of what was exported here, by every version so far; nerfstudio's own cameras have no time
    ".usda": ('doc = "Camera path of cltransfer.',),
    ".py": ("# A camera path of cltransfer.",),
    ".json": ('"camera_path": [', '"time": '),
}


def export_path(source: Path, out: Path, fps: float | None, y_up: bool | None, side: int | None = None) -> Trajectory:
    """Write the path of ``source`` as what the name of ``out`` says; returns the cameras that were written.

    Args:
        source: folder of a run, or a ``trajectory.json``.
        out: ``.usda``, ``.py`` (Blender), ``.json`` (nerfstudio), or a folder (COLMAP).
        fps: frames a second, the camera led smoothly through those that the path has; None: only those.
        y_up: whether other programs turn the scene's file, as they do glTF and OBJ; None: where that of the run is of
            :data:`TURNED`, and not of a trajectory alone. Of :data:`WORLDS` only.
        side: longer side of the picture [px]; None: that of the path. Files, of films, have a column and a row more
            where these are odd.

    Raises:
        UsageError: ``out`` has another ending, or is what a run, another program or a person has written; ``fps`` is
            out of range; ``y_up`` changes nothing.
        InputError: ``source`` is no such thing, a run that was not finished or does not tell whether its scene is
            turned, or the format has no room for its lens.
    """
    kind = "" if out.is_dir() else out.suffix.lower()
    _check_out(out, kind, source)
    if y_up is not None and kind not in WORLDS:
        raise UsageError("", "--y-up", f"changes nothing of this format, only of {' and '.join(WORLDS)}")
    run = source.is_dir()
    if run:
        require_run(source, "the folder of a run, or a trajectory.json")
        require_done(source)
    trajectory = at_rate(Trajectory.load(source / TRAJECTORY if run else source), fps, FRAMES)
    trajectory = trajectory if side is None else at_side(trajectory, side)
    if kind:  # images of a model are those of the run, whatever their size
        trajectory = filmable(trajectory, centred=kind == ".json")
    turned = _turned(source) if run and y_up is None and kind in WORLDS else bool(y_up)
    rate = fps or rate_of(trajectory)
    if kind == ".usda":
        write_usd(out, trajectory, rate, turned)
    elif kind == ".py":
        write_blender(out, trajectory, rate, turned)
    elif kind == ".json":
        write_camera_path(out, trajectory, fps)
    else:
        write_colmap(out, trajectory)
    return trajectory


def _turned(run: Path) -> bool:
    """Whether other programs turn the scene of a run.

    Raises:
        InputError: its manifest does not tell: an older version made it, or the scene is put together of files or was
            given from Python.
    """
    try:
        file = read_json(run / MANIFEST)["scene"]["file"]
    except (KeyError, TypeError):
        file = None
    if file in (None, ".yaml", ".yml"):
        reason = "does not tell whether other programs turn the scene's files, y to z, as they do glTF and OBJ"
        raise InputError(run / MANIFEST, "scene", reason, "say --y-up or --no-y-up")
    return file in TURNED


def _check_out(out: Path, kind: str, source: Path) -> None:
    """Refuse an ``out`` of no known ``kind``, and one that a run or another program has written."""
    if kind not in (*WORLDS, ".json", ""):
        expected = "expected a name that ends in .usda, .py (Blender) or .json (nerfstudio), or a folder (COLMAP)"
        raise UsageError(out, "--out", expected, "a new folder has no ending")
    if str(out) == "-":
        raise UsageError(out, "--out", "expected the name of a file or folder")
    check_out_file(out) if kind else check_model(out)
    target = Path(os.path.realpath(out))
    kept = [source, *kept_by_runs(target, source.resolve())]
    around = [] if kind else [file for file in kept if Path(os.path.realpath(file)).is_relative_to(target)]
    if around or any(same_file(target, file) for file in kept):
        raise UsageError(out, "--out", "is a file of a run itself, or what is read", "name another")
    if kind and not _exported(target, kind):
        raise UsageError(out, "--out", "is there, and was not exported here", "name another, or take it away first")


def _exported(file: Path, kind: str) -> bool:
    """Whether nothing lies at ``file``, or what an earlier export has written there."""
    if not file.is_file() or not file.stat().st_size:
        return True
    return all(head_holds(file, mark) for mark in MARKS[kind])
