"""The story of a transfer: reference + scene + config -> cameras, measured, rendered and written down."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from .camera import Camera, resized
from .config import RunConfig
from .driver.follow import Path as FoundPath
from .driver.follow import follow, smoothed, still
from .driver.initial_view import best_of_orbit, given_view
from .driver.schedule import Schedule, make_schedule
from .driver.stage import Spent, Stage
from .features import Features
from .graph import Family
from .objective import Objective
from .reference import (
    Components,
    Progress,
    Reading,
    Reference,
    clip_features,
    quantised,
    read_reference,
    silent,
)
from .scenes import Scene
from .scenes.lifted import cached_lift, lift_scene, load_person, save_lift
from .scenes.load import load_scene
from .scores import Scores, score, tabulate
from .threads import set_threads, thread_count
from .tracks import cleaned
from .trajectory import Trajectory

SMOOTH_WORTH = 1.25  # a filtered path may cost this much more total loss, and a tenth of a tolerance
RENDER_BATCH = 8  # frames of the final video rendered together


@dataclass(frozen=True)
class Inputs:
    """What a transfer is given beside its config.

    Args:
        scene: a scene file or ``builtin:NAME``.
        reference: see :func:`cltransfer.reference.read_reference`.
        init: ``auto``, or see :func:`cltransfer.driver.initial_view.given_view`.
        subject: a subject.json; None lifts the scene, or takes the lift from the cache.
        up: the scene's up; None takes the format's usual one.
    """

    scene: str
    reference: str
    init: str = "auto"
    subject: Path | None = None
    up: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Result:
    """What a transfer found.

    Args:
        scene, reference: what it was given, read.
        trajectory: N cameras at the output size.
        home: the initial view.
        image: the rendered frames, (N, 3, H, W) uint8.
        searched: the score in the search, by the inner extractors at the search size, of the cleaned reference.
        verified: the score of the rendered frames as they are kept; it is what the run reports.
        held: the same for the first view held still.
        schedule: how frames were searched.
        read_by: image (networks on both sides) or geometry (a scene taught a scene).
        path: smooth or exact, whichever was kept.
        found: each frame's minimum.
        spent: what it cost.
        seconds: by step.
    """

    scene: Scene
    reference: Reference
    trajectory: Trajectory
    home: Camera
    image: Tensor  # (N, 3, H, W) uint8
    searched: Scores
    verified: Scores
    held: Scores
    schedule: Schedule
    read_by: str
    path: str
    found: FoundPath
    spent: Spent
    seconds: dict[str, float]


def transfer(inputs: Inputs, config: RunConfig, progress: Progress = silent) -> Result:
    """Find the cameras that reproduce the reference's camera language in the scene.

    Raises:
        UsageError: the config asks for what the scene or the reference cannot give.
        InputError: a file is missing or damaged, or shows no person.
        ModelError: a network is missing.
    """
    clock = Clock()
    set_threads(config.threads or thread_count())
    parts = Components.build(config)
    family: Family = "scene" if config.extract.inner == "geometric" else "image"
    search = config.build_one("search")
    scene = given_scene(inputs)  # read before the reference: what is wrong with it shows at once
    view = None if inputs.init == "auto" else given_view(inputs.init)
    clock.lap("scene")
    reading = Reading(config.frames, config.output_side, family)
    reference = read_reference(inputs.reference, parts, reading, progress)
    if reference.family == "image" and (config.extract.verify or family == "image"):
        parts.plan("image").load_networks()
    wanted = cleaned(reference.features, config.clean) if reference.family == "image" else reference.features
    clock.lap("reference")
    if scene.subject is None and (family == "scene" or search.needs_subject or view is None):
        scene = with_lift(scene, parts, progress)
        clock.lap("lift")

    plan = parts.plan(family, shared=reference.features.names())
    small, output = (fit(reference.features.size, side) for side in (config.search_side, config.output_side))
    stage = Stage(scene, parts.renderer, plan, Objective(parts.losses), small)
    schedule = make_schedule(config, stage.objective, wanted)
    if view is None:
        homes = best_of_orbit(stage, first_seen(wanted), output, schedule.free_lens)
    else:
        homes = resized(view, output)
    clock.lap("initial view")
    count, searching = len(reference), stage.reduced(homes[0], config.lod)
    found = follow(
        searching, search, wanted, homes, schedule, lambda i, _: progress("frames", i + 1, count)
    )
    cameras, kind = _smooth(stage, search, wanted, homes[0], found, config.smooth)
    clock.lap("search")

    trajectory = Trajectory(cameras, reference.times)
    image = render_frames(scene, parts, trajectory.camera, progress)
    clock.lap("render")
    terms = stage.path_terms(wanted, cameras)
    searched = tabulate(stage.objective, wanted, terms, reference.missing)
    verified, held, read_by = _verify(stage, parts, reference, trajectory, image, config)
    clock.lap("verification")
    return Result(
        scene=scene,
        reference=reference,
        trajectory=trajectory,
        home=homes[0],
        image=image,
        searched=searched,
        verified=verified,
        held=held,
        schedule=schedule,
        read_by=read_by,
        path=kind,
        found=found,
        spent=stage.spent,
        seconds=clock.seconds,
    )


class Clock:
    """Seconds by step."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, step: str) -> None:
        """Everything since the last lap was ``step``."""
        now = time.perf_counter()
        self.seconds[step] = now - self._last
        self._last = now


def fit(size: tuple[int, int], side: int) -> tuple[int, int]:
    """(W, H) of the same shape whose longer side is ``side`` [px].

    >>> fit((1920, 1080), 160)
    (160, 90)
    """
    scale = side / max(size)
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))


def given_scene(inputs: Inputs) -> Scene:
    """The scene, with its person where that is given or known."""
    scene = load_scene(inputs.scene, inputs.up)
    return scene if inputs.subject is None else load_person(scene, inputs.subject)


def first_seen(features: Features) -> Features:
    """The first frame that shows a person; the first of all where joints were not read."""
    if not features.has("keypoints"):
        return features[0]
    seen = torch.isfinite(features.require("keypoints")[..., 0]).any(1)  # (N,)
    return features[int(seen.int().argmax())]


def with_lift(scene: Scene, parts: Components, progress: Progress = silent) -> Scene:
    """The scene with its person from the cache by content, or lifted now (and cached)."""
    cached = cached_lift(scene, parts.extractors)
    if not cached.is_file():
        found = lift_scene(scene, parts.renderer, parts.extractors, progress=lambda step: progress(step, 0, 0))
        save_lift(cached.parent, found)
    return load_person(scene, cached)


def render_frames(scene: Scene, parts: Components, cameras: Camera, progress: Progress = silent) -> Tensor:
    """Frames (N, 3, H, W) uint8 of N cameras."""
    frames = []
    for start in range(0, len(cameras), RENDER_BATCH):
        part = parts.renderer.render(scene, cameras[start : start + RENDER_BATCH], frozenset({"image"}))
        frames.append(quantised(part.image))
        progress("rendering", min(start + RENDER_BATCH, len(cameras)), len(cameras))
    return torch.cat(frames)


def _smooth(
    stage: Stage, search: object, reference: Features, home: Camera, found: FoundPath, frames: float
) -> tuple[Camera, str]:
    """The filtered path where it costs little more than the one found, else the one found."""
    if frames <= 0:
        return found.camera, "exact"
    cameras = search.cameras(smoothed(found.x, frames), home, stage.scene.subject)  # type: ignore[attr-defined]
    defined = stage.objective.defined(reference)
    exact, smooth = (
        float(stage.objective.totals(stage.path_terms(reference, path), defined).mean())
        for path in (found.camera, cameras)
    )
    return (cameras, "smooth") if smooth <= SMOOTH_WORTH * exact + 0.1 else (found.camera, "exact")


def _verify(
    stage: Stage, parts: Components, reference: Reference, trajectory: Trajectory, image: Tensor, config: RunConfig
) -> tuple[Scores, Scores, str]:
    """Scores of the result and of its first view held still, by what the reference was read with."""
    plan = parts.plan(reference.family)
    if reference.family == "image" and config.extract.verify:
        rendered = clip_features(image, plan)
        twice = clip_features(image[[0, 0]], plan)
        held = twice[[0] + [1] * (len(image) - 1)]
        stage.spent.network_passes += (len(image) + 2) * plan.passes
        read_by = "image"
    else:
        full = replace(stage, size=trajectory.camera.size)
        rendered = _read_path(full, trajectory.camera)
        held = _read_path(full, still(trajectory.camera, len(trajectory)))
        read_by = "image" if reference.family == "image" and config.extract.inner == "image" else "geometry"
    scores = [score(stage.objective, reference.features, f, reference.missing) for f in (rendered, held)]
    return scores[0], scores[1], read_by


def _read_path(stage: Stage, cameras: Camera) -> Features:
    """Features of a path, each frame with the one before it."""
    frames, before = [], None
    for i in range(len(cameras)):
        before = stage.features(cameras[i], before)
        frames.append(replace(before, image=None))
    return Features.concatenate(frames)
