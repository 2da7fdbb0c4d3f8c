"""The story of a transfer: reference + scene + config -> cameras, measured, rendered and written down."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from torch import Tensor

from .camera import Camera, concatenate
from .config_options import RunConfig
from .correct import LEAST, corrected, measure_bias
from .depth_alignment import DepthAlignment
from .driver.follow import Path, follow
from .driver.frame import Solved
from .driver.joint import Effort
from .driver.path_order import LeastPath, least_path
from .driver.schedule import Schedule
from .driver.second_guide import first_views, second_guide
from .driver.stage import Spent, Stage
from .driver.whole_clip import WholeClip
from .features import Features
from .objective import Objective
from .preparation import Clock, Inputs, Job, Record, prepare
from .progress import Progress, silent
from .readback import Readback, read_back, read_held, read_path
from .reference import Reference
from .scenes import Scene
from .scores import Scores, tabulate
from .trajectory import Trajectory

Report = Callable[[int, Solved], None]

BIAS_WINDOW = 4.0  # [frames] along which the networks' bias is taken to be steady
UNBIASED = f"no correction: no bias of the networks is known, it takes {LEAST} frames in which a reading is sure"


@dataclass(frozen=True)
class Attempt:
    """One round of search and reading back.

    Args:
        found: each frame's minimum.
        cameras: N, of the path taken, at the output size.
        path: its order; None where every frame was left as it was found.
        shown: its frames, read and scored.
        blocked: views that a search must not take, (N,) bool by reason.
    """

    found: Path
    cameras: Camera
    path: LeastPath | None
    shown: Readback
    blocked: dict[str, Tensor]  # (N,) each


@dataclass(frozen=True)
class Result:
    """What a transfer found.

    Args:
        scene, reference: what it was given, read; the scene without its floaters where the config says so.
        trajectory: N cameras at the output size.
        attempts: every round; the first is uncorrected.
        best: index of the round with the lowest total, the one that is kept.
        searched: the score in the search, by the inner extractors at the search size, of the cleaned reference.
        held: the score of the first view held still.
        search: vectors to cameras.
        objective: the losses.
        schedule: how frames were searched.
        note: why there were fewer rounds than the config asks for, empty where there were not.
        noise: total that cannot be told apart, because networks read both sides; 0 where geometry did.
        read_by: image (networks read the result too) or geometry (a scene taught a scene, or ``extract.verify=false``).
        spent: what it cost.
        seconds: by step.
        alignment: of the depth network, where the scene told it.
        floaters: Gaussians that were left out of the scene.
    """

    scene: Scene
    reference: Reference
    trajectory: Trajectory
    attempts: tuple[Attempt, ...]
    best: int
    searched: Scores
    held: Scores
    search: Any
    objective: Objective
    schedule: Schedule
    note: str
    noise: float
    read_by: str
    spent: Spent
    seconds: dict[str, float]
    alignment: DepthAlignment | None = None
    floaters: int = 0

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


def transfer(inputs: Inputs, config: RunConfig, progress: Progress = silent, record: Record | None = None) -> Result:
    """Find the cameras that reproduce the reference's camera language in the scene.

    Args:
        inputs: scene, reference and initial view.
        config: everything else.
        progress: called with a step, frames done, frames in all.
        record: where every batch of candidates for one frame is kept, so that a run that was killed can go on; whole
            paths are not, a resumed run scores them again. None keeps nothing.

    Raises:
        UsageError: the config asks for what the scene or the reference cannot give.
        InputError: a file is missing or damaged, or shows no person.
        ModelError: a network is missing.
    """
    clock = Clock()
    job = prepare(inputs, config, clock, progress, record)
    attempts, note = _attempts(job, config, clock, progress)
    kept = min(range(len(attempts)), key=lambda i: attempts[i].shown.scores.total)
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
        search=job.search,
        objective=stage.objective,
        schedule=job.schedule,
        note=note,
        noise=job.noise,
        read_by="image" if job.by_networks or config.extract.inner == "image" else "geometry",
        spent=stage.spent,
        seconds=clock.seconds,
        alignment=job.alignment,
        floaters=job.floaters,
    )


def _attempts(job: Job, config: RunConfig, clock: Clock, progress: Progress) -> tuple[list[Attempt], str]:
    """Effort of search and reading back; after the first, aimed off the networks' bias. And why there are no more."""
    corrects = job.by_networks and config.extract.inner == "geometric"
    rounds = config.extract.corrections if corrects else 0
    target, homes, guide, attempts = job.wanted, job.homes, job.guide, list[Attempt]()
    for number in range(rounds + 1):
        searching = job.stage.reduced(homes[0], config.lod)
        step = f"frames, round {number + 1}" if rounds else "frames"
        report = _counting(progress, step, len(job.reference))
        clip = WholeClip(job.stage, job.search, target, homes[0])
        found, path = _searched(job, config, searching, clip, homes, guide, report)
        cameras = found.camera if path is None else clip.cameras(path.x)
        clock.lap("search")
        shown = read_back(job.stage, job.parts, job.reference, cameras, job.by_networks, progress)
        last = number == rounds
        seen = None if last and job.stage.guard is None else read_path(job.stage, cameras)
        attempts.append(Attempt(found, cameras, path, shown, _blocked(job.stage, seen)))
        clock.lap("reading back")
        if last or seen is None:
            break
        bias = measure_bias(shown.features, seen, BIAS_WINDOW if config.extract.bias == "robust" else 0.0)
        if not bias.known:
            return attempts, UNBIASED
        target, homes = corrected(job.wanted, bias), cameras[0]
        guide = clip.about(cameras[0], found.x if path is None else path.x)
    return attempts, ""


def _searched(
    job: Job, config: RunConfig, stage: Stage, clip: WholeClip, homes: Camera, guide: Tensor | None, report: Report
) -> tuple[Path, LeastPath | None]:
    """The frames of one round, and the path through them where one is asked for."""
    found = _followed(job, stage, clip.reference, homes, report, guide)
    if config.path == "exact":
        return found, None
    return found, _least(job, config, clip, found, guide)


def _least(job: Job, config: RunConfig, clip: WholeClip, found: Path, guide: Tensor | None) -> LeastPath:
    local = found.local
    if local is not None and config.lod > 0:  # merged, the scene has other residuals
        local = replace(local, residuals=clip.residuals(found.x))
    return least_path(clip, found.x, local, job.noise, Effort(config.joint, config.joint_steps), guide)


def _followed(job: Job, stage: Stage, target: Features, homes: Camera, report: Report, guide: Tensor | None) -> Path:
    """The clip followed leanly where that is good enough, else thoroughly too; the best.

    Where part of it ended right and the rest at other distances, it is followed once more, at those of the former.
    """
    schedule, subject = job.schedule, stage.scene.subject
    found = _followed_from(job, stage, target, homes, report, guide)
    if found.local is None or guide is None or subject is None:
        return found
    again = second_guide(job.search, target, homes[0], subject, guide, found.x, found.totals)
    if again is None:
        return found
    starts = concatenate([homes, first_views(job.search, target, homes[0], subject, again)])
    return _better(found, follow(stage, job.search, target, starts, schedule.lean, report, again))


def _followed_from(
    job: Job, stage: Stage, target: Features, homes: Camera, report: Report, guide: Tensor | None
) -> Path:
    schedule = job.schedule
    if not schedule.lean_limit or schedule.engine != "refine" or not schedule.warm:
        return follow(stage, job.search, target, homes, schedule, report, guide)
    first = follow(stage, job.search, target, homes, schedule.lean, report, guide)
    if first.local is None or (first.local.total <= schedule.lean_limit and not first.drifts):
        return first
    return _better(first, follow(stage, job.search, target, homes, schedule, report, guide))


def _better(first: Path, second: Path) -> Path:
    assert first.local is not None
    return second if second.local is not None and second.local.total < first.local.total else first


def _counting(progress: Progress, step: str, count: int) -> Report:
    def report(frame: int, solved: Solved) -> None:
        progress(step, frame + 1, count)

    return report


def _blocked(stage: Stage, seen: Features | None) -> dict[str, Tensor]:
    return {} if stage.guard is None or seen is None else stage.guard.reasons(seen)
