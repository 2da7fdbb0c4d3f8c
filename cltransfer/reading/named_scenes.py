"""Scenes by what a person or a run says of them: a scene with a trajectory, or a digest seen here before."""

from __future__ import annotations

import shlex
from pathlib import Path

from ..clips.thinned import evenly
from ..drawing import OURS
from ..errors import InputError
from ..registry.declared import BUILTIN
from ..scenes import Scene
from ..scenes.load import load_scene
from ..scenes.person.lifted import load_person
from ..storage.files import cache_dir, into_cache, read_json, write_json
from ..storage.run_files import SUBJECT, TRAJECTORY, is_run, require_done
from ..trajectory import Trajectory
from .odd_lenses import tell_beside, tell_oblong
from .scene_source import split_scene

REFERENCE_ASPECT = (16, 9)
REFERENCE_FRAMES = 24


def load_reference_scene(source: str, frames: int | None, side: int) -> tuple[Scene, Trajectory]:
    """Scene and cameras of a reference that is shot in a scene.

    Args:
        source: ``builtin:SHOT``, or ``SCENE@TRAJECTORY.json``; the scene's person is ``subject.json`` beside the
            trajectory, unless the scene knows its own.
        frames: how many; a trajectory is taken whole or thinned evenly, a shot is made of so many at 12 a second.
        side: longer side of its frames [px].

    Raises:
        InputError: a file is missing or damaged, or of a run that was not finished.
        UsageError: there is no such built-in shot.
    """
    split = split_scene(source)
    if split is None:
        from ..shots import builtin_reference

        size = (side, round(side * REFERENCE_ASPECT[1] / REFERENCE_ASPECT[0]))
        return builtin_reference(source.removeprefix(BUILTIN), size, frames or REFERENCE_FRAMES)
    scene_name, path = split[0], Path(split[1])
    require_done(path.parent)
    trajectory = Trajectory.load(path)
    scene = load_scene(scene_name)
    if scene.subject is None and path.with_name(SUBJECT).is_file():
        scene = load_person(scene, path.with_name(SUBJECT))
    tell_beside(path, trajectory.camera, "every search has it there")
    return scene, _thinned(_square(path, trajectory), frames, side)


def lift_command(source: str, scene: Scene) -> str:
    """By what command the person of ``scene`` comes to lie where :func:`load_reference_scene` looks for it."""
    named, path = split_scene(source) or (source, TRAJECTORY)
    folder, kind = Path(path).parent, getattr(scene.geometry, "renderer", "")
    drawn = f" renderer.{kind}={{}}" * (kind in OURS[1:])  # the first is that of the config by default
    command = f"cltransfer lift {shlex.quote(named)}{drawn} --out"
    if is_run(folder):  # into which no lift goes
        return f"copy {shlex.quote(path)} into a FOLDER of its own, and run: {command} FOLDER"
    return f"run: {command} {shlex.quote(str(folder))}"


def _square(path: Path, trajectory: Trajectory) -> Trajectory:
    """The trajectory in a frame of square pixels, as wide as makes those of its first camera square, as of a clip."""
    camera = trajectory.camera
    width = max(1, round(float(camera.size[0] * camera.K[0, 1, 1] / camera.K[0, 0, 0])))
    then = f"its frame is taken as {width}x{camera.size[1]}, of square pixels"
    if not tell_oblong(path, camera, then):
        return trajectory
    return Trajectory(camera.at_size((width, camera.size[1])), trajectory.times)


def _thinned(trajectory: Trajectory, frames: int | None, side: int) -> Trajectory:
    index = evenly(trajectory.times, frames)
    width, height = trajectory.camera.size
    scale = side / max(width, height)
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    return Trajectory(trajectory.camera[index].at_size(size), trajectory.times[index] - trajectory.times[0])


def remember(digest: str, source: str) -> None:
    """Note where a scene of this content was found, so that a run folder need not name a path."""
    where = source if source.startswith(BUILTIN) else str(Path(source).resolve())
    note = cache_dir() / "scenes" / f"{digest}.json"
    with into_cache(note, f"a later render needs --scene {shlex.quote(where)}"):
        write_json(note, {"path": where})


def recall(digest: str, given: bool = False) -> str:
    """Where a scene of this content was last found on this computer.

    Args:
        digest: of the scene.
        given: whether the run that asks for it was given it from Python, so that it may lie in no file.

    Raises:
        InputError: it was never seen here.
    """
    note = cache_dir() / "scenes" / f"{digest}.json"
    known = read_json(note) if digest.isalnum() and note.is_file() else None
    if not isinstance(known, dict) or not isinstance(known.get("path"), str):
        again = "its scene was given from Python: run it there with a larger output_side"
        hint = again if given else "name it: --scene FILE or builtin:NAME"
        raise InputError("", "scene", "this computer has not seen the scene of this run", hint)
    return str(known["path"])
