"""A run rendered once more: larger, or as a film."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from ..camera import Camera, fitted_size, resized
from ..clips.clip import write_video
from ..computer.threads import default_count, set_threads, threads_restored
from ..config import load_config
from ..drawing import drawn_by
from ..driver.guard import Guard
from ..errors import InputError, UsageError
from ..features import Features
from ..pipeline.components import Components
from ..progress import Progress
from ..reading.named_scenes import recall
from ..registry.declared import BUILTIN
from ..scenes import Scene
from ..scenes.load import load_scene
from ..storage.alone import alone
from ..storage.files import check_out_file, content_hash, read_json, same_file
from ..storage.run_files import CONFIG, MANIFEST, SUBJECT, TRAJECTORY, VIDEO, kept_by_runs, require_done, require_run
from ..subject import Subject
from ..trajectory import Trajectory
from .frame_rate import at_rate
from .readback import RENDER_BATCH, render_frames

ACTING = ("output_side", "renderer", "threads")  # keys of the config that change how a path is drawn
LOOKED_AT = 160  # longer side at which the frames between are looked at [px]
MARK = "A film of cltransfer."  # what a film that was rendered here says of itself
TAIL = 4096  # bytes at the end of a file within which it says so


@dataclass(frozen=True)
class Film:
    """A video that was made of a run.

    Args:
        video: the file.
        notes: what is doubtful in the frames between those of the run.
    """

    video: Path
    notes: tuple[str, ...] = ()


@threads_restored()
def render_run(
    run: Path, overrides: Sequence[str], fps: float | None, scene: str | None, out: Path | None, progress: Progress
) -> Film:
    """Render the video of a run again.

    No search has seen the frames between those of the run, so they are looked at for what a search would not take.

    Args:
        run: folder of the run.
        overrides: config on top of the run's, of :data:`ACTING`, e.g. ``output_side=1280``.
        fps: frames a second, between those of the run too, the camera led smoothly through them; None is the run's own.
        scene: the scene, where this computer has not seen it; it must have the content the run was made with.
        out: the video; None is ``RUN/video/render.mp4``.
        progress: called with a step, frames done, frames in all.

    Raises:
        UsageError: ``out`` is no .mp4, cannot be written or is another file of this run, its reference, any of another
            run, or one that was not rendered here; the run's config cannot be meant, a key changes nothing here, or
            ``fps`` makes too many frames.
        InputError: the folder is no run or one that was not finished, or the scene is another one.
        ResourceError: the frames cannot be kept in memory, or another process writes into the folder.
    """
    if out is not None and out.suffix.lower() != ".mp4":
        raise UsageError(out, "--out", "expected a name that ends in .mp4")
    check_out_file(out)
    own = out is None or same_file(out, run / VIDEO)
    if out is not None and not own and any(same_file(out, file) for file in kept_by_runs(out, run)):
        raise UsageError(out, "--out", "is a file of a run itself", "name another")
    _check_keys(overrides)
    require_run(run)
    inside = out is None or out.resolve().is_relative_to(run.resolve())
    with alone(run, "writes a run") if inside else nullcontext():
        return _filmed_run(run, overrides, fps, scene, out or run / VIDEO, progress)


def _filmed_run(
    run: Path, overrides: Sequence[str], fps: float | None, scene: str | None, target: Path, progress: Progress
) -> Film:
    require_done(run)
    if not same_file(target, run / VIDEO):
        _check_film(target, run)
    digest, up, given = _scene_of(run)
    config = load_config(run / CONFIG, overrides, whole=True)
    if not (run / CONFIG).stat().st_size:
        raise UsageError(run / CONFIG, "", "is empty", "a run keeps its whole config")
    trajectory = at_rate(Trajectory.load(run / TRAJECTORY), fps)
    set_threads(config.threads or default_count())
    parts = Components.build(config)
    source = scene or recall(digest, given)
    asked = None if source.startswith(BUILTIN) else up  # a built-in scene has its own
    loaded = load_scene(source, asked) if scene else _recalled(source, asked)
    if loaded.digest != digest:
        raise InputError(source, "sha256", "is not the scene of this run", "name the right one: --scene FILE")
    cameras = resized(trajectory.camera, fitted_size(trajectory.camera.size, config.output_side))
    image = render_frames(loaded, parts, cameras, progress)
    progress("writing the video", 0, 0)
    write_video(target, image, trajectory.times, comment=MARK)
    if fps is None:
        return Film(target)
    person = Subject.load(run / SUBJECT) if (run / SUBJECT).is_file() else None
    progress("looking at what lies between", 0, 0)
    return Film(target, tuple(_doubts(loaded, parts, cameras, trajectory.times, person)))


def _check_film(out: Path, run: Path) -> None:
    """Refuse an ``out`` that is there and no earlier film, or one that the run in ``run`` was made from."""
    if not out.is_file() or not out.stat().st_size:
        return
    with out.open("rb") as stream:
        stream.seek(max(0, out.stat().st_size - TAIL))
        ours = MARK.encode() in stream.read()
    if not ours:
        raise UsageError(out, "--out", "is there, and was not rendered here", "name another, or take it away first")
    if content_hash(out) == _reference_of(run):
        raise UsageError(out, "--out", "is the reference of this run", "name another")


def _check_keys(overrides: Sequence[str]) -> None:
    for override in overrides:
        key = override.partition("=")[0].partition(".")[0]
        if key not in ACTING:
            what = "the path of a run stands; only how it is drawn can change"
            raise UsageError("", key, what, f"{', '.join(ACTING)}, and --fps for more frames a second")


def _reference_of(run: Path) -> str:
    """Digest of the reference of a run."""
    try:
        return str(read_json(run / MANIFEST)["reference"]["sha256"])
    except (KeyError, TypeError):
        raise InputError(run / MANIFEST, "reference", "expected sha256") from None


def _scene_of(run: Path) -> tuple[str, tuple[float, float, float], bool]:
    """Digest and up of the scene that a run was made in, and whether Python gave it."""
    try:
        scene = read_json(run / MANIFEST)["scene"]
        up = scene["up"]
        given = scene.get("file", "") is None  # an older manifest does not tell
        return str(scene["sha256"]), (float(up[0]), float(up[1]), float(up[2])), given
    except (KeyError, AttributeError, TypeError, ValueError, IndexError, OverflowError):
        raise InputError(run / MANIFEST, "scene", "expected sha256 and up") from None


def _recalled(source: str, up: tuple[float, float, float] | None) -> Scene:
    """The scene from where this computer has last seen it."""
    try:
        return load_scene(source, up)
    except InputError as error:
        hint = error.hint or "it has been moved? name it: --scene FILE"
        raise InputError(error.where, error.field, error.reason, hint) from None


def _doubts(scene: Scene, parts: Components, cameras: Camera, times: Tensor, person: Subject | None) -> Iterator[str]:
    """What is wrong with the frames of N cameras at ``times`` (N,) [s], a line for each reason."""
    small = cameras.at_size(fitted_size(cameras.size, LOOKED_AT))
    guard, found = Guard(None if person is None else person.height), list[dict[str, Tensor]]()
    for start in range(0, len(small), RENDER_BATCH):
        some = small[start : start + RENDER_BATCH]
        depth = drawn_by(parts.renderer, scene, some, frozenset({"depth"})).require("depth")
        found.append(guard.reasons(Features(size=some.size, depth=depth, camera=some, person=person)))
    for reason in found[0]:
        wrong = torch.cat([reasons[reason] for reasons in found])
        if wrong.any():
            first, last = (float(times[wrong][i]) for i in (0, -1))
            yield f"{reason} in {int(wrong.sum())} of {len(wrong)} frames, {first:.2f} to {last:.2f} s"
