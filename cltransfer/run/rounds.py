"""Rounds of search and reading back; after the first, aimed off the networks' bias."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from torch import Tensor

from ..camera import Camera, concatenate
from ..config.options import RunConfig
from ..driver.follow import Path
from ..driver.frame import Solved
from ..driver.guard import hidden_share
from ..driver.path_order import LeastPath
from ..driver.stage import Stage, read_path
from ..driver.starts import Starts
from ..features import Features, nobody
from ..progress import Progress
from ..skeleton import VISIBLE
from .correct import LEAST, corrected, measure_bias
from .left_out import LeftOut
from .preparation import Clock, Job
from .readback import Readback, read_back
from .search_path import search_path
from .take import Report

BIAS_WINDOW = 4.0  # [frames] along which the networks' bias is taken to be steady
MAY_HIDE = 0.1  # of the joints, in rounds after one of which the networks lost the person behind something
REFUSED = 10.0  # total above which CMA-ES then looks for a view of a frame; one that the guard refuses costs more
UNBIASED = f"correction: no bias of the networks is known, it takes {LEAST} frames in which a reading is sure"
UNSEEN = "no correction: the networks see nobody in the render"
UNREAD = "no correction: extract.verify=false reads no render by the networks"


@dataclass(frozen=True)
class Attempt:
    """One round of search and reading back.

    Args:
        found: each frame's minimum.
        cameras: N, of the path taken, at the output size.
        path: its order; None where every frame was left as it was found.
        shown: its frames, in the scene as it was given, read and scored.
        blocked: views that a search must not take, (N,) bool by reason.
        left_out: what the search did not see, None where it saw everything.
    """

    found: Path
    cameras: Camera
    path: LeastPath | None
    shown: Readback
    blocked: dict[str, Tensor]  # (N,) each
    left_out: LeftOut | None

    @property
    def x(self) -> Tensor:
        """The path taken, (N, D)."""
        return self.found.x if self.path is None else self.path.x


def best_of(made: Sequence[Attempt]) -> int:
    """Index of the round with the lowest total, the first of several."""
    return min(range(len(made)), key=lambda i: made[i].shown.scores.total)


def attempts(job: Job, config: RunConfig, clock: Clock, progress: Progress) -> tuple[list[Attempt], str]:
    """Rounds of search and reading back; after the first, aimed off the networks' bias. And why there are no more."""
    corrects = job.reference.family == "image" and config.extract.inner == "geometric"
    asked = config.extract.corrections if corrects else 0
    rounds = asked if job.by_networks else 0
    stage = replace(job.stage, scene=job.solid)
    target, starts, reference, made = job.wanted, job.starts, job.reference, list[Attempt]()
    for number in range(rounds + 1):
        step = f"frames, round {number + 1}" if rounds else "frames"
        report = _counting(progress, step, len(job.reference))
        take = search_path(job, config, stage, target, starts, report)
        stage, cameras = take.clip.stage, take.cameras
        clock.lap("search")
        shown = read_back(job.stage, job.parts, reference, cameras, job.by_networks, progress)
        reference = shown.reference  # what one round had to do without no later one has
        last = number == rounds
        seen = None if last and job.stage.guard is None else read_path(job.stage, cameras)
        made.append(
            Attempt(take.found, cameras, take.path, shown, _blocked(job.stage, seen, job.wanted), take.left_out)
        )
        clock.lap("reading back")
        if last or seen is None:
            break
        window = BIAS_WINDOW if config.extract.bias == "robust" else 0.0
        bias = measure_bias(shown.features, seen, window, job.starting.at)
        target = job.wanted
        if _lost_behind_things(job, shown.features, seen):
            stage, starts = _watchful(stage), job.starts
            schedule = replace(job.schedule, rescue=min(job.schedule.rescue, REFUSED))
            job = replace(job, stage=_watchful(job.stage), schedule=schedule)
            continue
        if bool(nobody(shown.features).all()):
            return made, UNSEEN
        if not bias.known:
            return made, f"no {'further ' if number else ''}{UNBIASED}"
        homes = cameras[0] if config.warm_start else concatenate([cameras[0], job.starts.homes])
        target, starts = corrected(job.wanted, bias), Starts(homes, take.clip.about(cameras[0], take.x))
    return made, UNREAD if asked and not rounds else ""


def _lost_behind_things(job: Job, shown: Features, seen: Features) -> bool:
    """Whether the networks miss the person of a frame ``shown`` where, by the geometry ``seen``, things hide joints."""
    guard = job.stage.guard
    if guard is None or guard.hidden <= MAY_HIDE or not job.wanted.has("keypoints"):
        return False
    wanted = job.wanted.require("keypoints")[..., 2] > VISIBLE
    missed = nobody(shown) & ~nobody(job.reference.features)
    return bool((missed & (hidden_share(seen, wanted) > MAY_HIDE)).any())


def _watchful(stage: Stage) -> Stage:
    """The stage whose guard lets things hide but few joints."""
    assert stage.guard is not None
    return replace(stage, guard=replace(stage.guard, hidden=MAY_HIDE))


def _counting(progress: Progress, step: str, count: int) -> Report:
    def report(frame: int, solved: Solved) -> None:
        progress(step, frame + 1, count)
        if frame + 1 == count:
            progress(f"{step}: the path", 0, 0)  # through them, of which nobody knows how long it takes

    return report


def _blocked(stage: Stage, seen: Features | None, reference: Features) -> dict[str, Tensor]:
    return {} if stage.guard is None or seen is None else stage.guard.reasons(seen, reference)
