"""The story of a transfer: reference + scene + config -> cameras, measured, rendered and written down."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from .camera import Camera, resized
from .config import RunConfig
from .correct import corrected, measure_bias
from .driver.follow import Path as FoundPath
from .driver.follow import follow
from .driver.frame import Solved
from .driver.initial_view import best_of_orbit, first_seen, given_view
from .driver.journal import Journal
from .driver.path_order import LeastPath, WholeClip, least_path
from .driver.schedule import Schedule, make_schedule
from .driver.stage import Spent, Stage
from .features import Features
from .graph import Family
from .objective import Objective
from .readback import Readback, read_back, read_held, read_path
from .reference import Components, Progress, Reading, Reference, read_reference, silent
from .scenes import Scene
from .scenes.lifted import lifted_scene, load_person
from .scenes.load import load_scene
from .scores import Scores, tabulate
from .threads import set_threads, thread_count
from .tracks import cleaned
from .trajectory import Trajectory

BIAS_WINDOW = 4.0  # [frames] along which the networks' bias is taken to be steady


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
class Record:
    """The journal of a run.

    Args:
        path: of the file.
        resume: go on with what is there.
    """

    path: Path
    resume: bool = False


@dataclass(frozen=True)
class Attempt:
    """One round of search and reading back.

    Args:
        found: each frame's minimum.
        cameras: N, of the path taken, at the output size.
        path: its order; None where every frame was left as it was found.
        shown: its frames, read and scored.
    """

    found: FoundPath
    cameras: Camera
    path: LeastPath | None
    shown: Readback


@dataclass(frozen=True)
class Result:
    """What a transfer found.

    Args:
        scene, reference: what it was given, read.
        trajectory: N cameras at the output size.
        attempts: every round; the first is uncorrected.
        best: index of the round with the lowest total, the one that is kept.
        searched: the score in the search, by the inner extractors at the search size, of the cleaned reference.
        held: the score of the first view held still.
        schedule: how frames were searched.
        read_by: image (networks on both sides) or geometry (a scene taught a scene).
        spent: what it cost.
        seconds: by step.
    """

    scene: Scene
    reference: Reference
    trajectory: Trajectory
    attempts: tuple[Attempt, ...]
    best: int
    searched: Scores
    held: Scores
    schedule: Schedule
    read_by: str
    spent: Spent
    seconds: dict[str, float]

    @property
    def kept(self) -> Attempt:
        """The round that is kept."""
        return self.attempts[self.best]

    @property
    def verified(self) -> Scores:
        """The score of the rendered frames as they are kept; it is what the run reports."""
        return self.kept.shown.scores

    @property
    def image(self) -> Tensor:
        """The rendered frames, (N, 3, H, W) uint8."""
        return self.kept.shown.image


class Clock:
    """Seconds by step."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, step: str) -> None:
        """Everything since the last lap was ``step``."""
        now = time.perf_counter()
        self.seconds[step] = self.seconds.get(step, 0.0) + now - self._last
        self._last = now


def transfer(inputs: Inputs, config: RunConfig, progress: Progress = silent, record: Record | None = None) -> Result:
    """Find the cameras that reproduce the reference's camera language in the scene.

    Args:
        inputs: scene, reference and initial view.
        config: everything else.
        progress: called with a step, frames done, frames in all.
        record: where every evaluated batch is kept, so that a run that was killed can go on; None keeps nothing.

    Raises:
        UsageError: the config asks for what the scene or the reference cannot give.
        InputError: a file is missing or damaged, or shows no person.
        ModelError: a network is missing.
    """
    clock = Clock()
    job = _prepared(inputs, config, clock, progress, record)
    attempts = _attempts(job, config, clock, progress)
    kept = min(range(len(attempts)), key=lambda i: float(attempts[i].shown.scores.totals.mean()))
    best, stage, reference = attempts[kept], job.stage, job.reference
    terms = stage.path_terms(job.wanted, best.cameras)
    held = read_held(stage, job.parts, reference, best.shown, best.cameras)
    clock.lap("comparison")
    return Result(
        scene=stage.scene,
        reference=reference,
        trajectory=Trajectory(best.cameras, reference.times),
        attempts=tuple(attempts),
        best=kept,
        searched=tabulate(stage.objective, job.wanted, terms, reference.missing),
        held=held,
        schedule=job.schedule,
        read_by="image" if job.by_networks or config.extract.inner == "image" else "geometry",
        spent=stage.spent,
        seconds=clock.seconds,
    )


@dataclass(frozen=True)
class _Job:
    """Everything a search starts from."""

    parts: Components
    search: Any
    reference: Reference
    wanted: Features  # the reference, cleaned where it was read from a clip
    stage: Stage
    schedule: Schedule
    homes: Camera  # initial views, the best first
    by_networks: bool  # whether networks read the result


def _prepared(inputs: Inputs, config: RunConfig, clock: Clock, progress: Progress, record: Record | None) -> _Job:
    set_threads(config.threads or thread_count())
    parts = Components.build(config)
    family: Family = "scene" if config.extract.inner == "geometric" else "image"
    search = config.build_one("search")
    scene = given_scene(inputs)  # read before the reference: what is wrong with it shows at once
    view = None if inputs.init == "auto" else given_view(inputs.init)
    clock.lap("scene")
    reference = read_reference(inputs.reference, parts, Reading(config.frames, config.output_side, family), progress)
    by_networks = reference.family == "image" and config.extract.verify
    if by_networks or family == "image":
        parts.plan("image").load_networks()
    wanted = cleaned(reference.features, config.clean) if reference.family == "image" else reference.features
    clock.lap("reference")
    if family == "scene" or search.needs_subject or view is None:
        scene = lifted_scene(scene, parts.renderer, parts.extractors, lambda step: progress(step, 0, 0))
        clock.lap("lift")
    plan = parts.plan(family, shared=reference.features.names())
    small, output = (fit(reference.features.size, side) for side in (config.search_side, config.output_side))
    journal = None if record is None else Journal(record.path, _header(config, scene, reference), record.resume)
    stage = Stage(scene, parts.renderer, plan, Objective(parts.losses), small, journal=journal)
    schedule = make_schedule(config, stage.objective, wanted)
    if view is None:
        homes = best_of_orbit(stage, first_seen(wanted), output, schedule.free_lens)
    else:
        homes = resized(view, output)
    clock.lap("initial view")
    return _Job(parts, search, reference, wanted, stage, schedule, homes, by_networks)


def _header(config: RunConfig, scene: Scene, reference: Reference) -> dict[str, Any]:
    """What the answers of a run depend on."""
    return {
        **{f"config.{key}": value for key, value in asdict(config).items()},
        "scene": scene.digest,
        "reference": reference.digest,
        "versions": {name: metadata.version(name) for name in ("cltransfer", "torch", "numpy", "numba", "cma")},
        "threads": thread_count(),
    }


def _attempts(job: _Job, config: RunConfig, clock: Clock, progress: Progress) -> list[Attempt]:
    """Rounds of search and reading back; after the first, aimed off the networks' bias."""
    corrects = job.by_networks and config.extract.inner == "geometric"
    rounds = config.extract.corrections if corrects else 0
    noise = noise_floor(job.stage.objective, job.reference.features, job.wanted)
    target, homes, attempts = job.wanted, job.homes, list[Attempt]()
    for number in range(rounds + 1):
        searching = job.stage.reduced(homes[0], config.lod)
        step = f"frames, round {number + 1}" if rounds else "frames"
        report = _counting(progress, step, len(job.reference))
        found = follow(searching, job.search, target, homes, job.schedule, report)
        cameras, path = found.camera, None
        if config.path == "smooth":
            clip = WholeClip(job.stage, job.search, target, homes[0])
            path = least_path(clip, found.x, found.local(job.stage.objective), noise, config.joint)
            cameras = clip.cameras(path.x)
        clock.lap("search")
        shown = read_back(job.stage, job.parts, job.reference, cameras, job.by_networks, progress)
        attempts.append(Attempt(found, cameras, path, shown))
        clock.lap("reading back")
        if number < rounds:
            bias = measure_bias(shown.features, read_path(job.stage, cameras), BIAS_WINDOW)
            target, homes = corrected(job.wanted, bias), cameras[0]
    return attempts


def noise_floor(objective: Objective, read: Features, wanted: Features) -> float:
    """Total that the reference costs against itself once its jitter is filtered; nothing below it can be told apart."""
    terms = objective.terms(read, wanted)
    defined = torch.isfinite(terms) & objective.defined(read)
    return float(objective.totals(terms, defined).mean())


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


def _counting(progress: Progress, step: str, count: int) -> Callable[[int, Solved], None]:
    def report(frame: int, solved: Solved) -> None:
        progress(step, frame + 1, count)

    return report
