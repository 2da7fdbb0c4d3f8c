"""Rounds of search and reading back; after the first, aimed off the networks' bias or led to whom they lost."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..camera import Camera, concatenate
from ..driver.aiming import pitch_of
from ..driver.closed_form import Guide
from ..driver.follow import Path
from ..driver.frame import Solved
from ..driver.guard import hidden_share
from ..driver.path_order import LeastPath
from ..driver.stage import Stage, read_path
from ..driver.starts import NoViewError, Starts
from ..features import Features, nobody
from ..progress import Progress
from ..skeleton import VISIBLE
from .correct import LEAST, Bias, corrected, measure_bias
from .left_out import LeftOut
from .preparation import Clock, Job
from .readback import Readback, read_back
from .scene_end import SCENE_ENDS, shows_end
from .search_path import search_path
from .take import FrameDone, Take

BIAS_WINDOW = 4.0  # [frames] along which the networks' bias is taken to be steady
MAY_HIDE = 0.1  # of the joints, in rounds after one of which the networks lost the person behind something
TOLD = 0.25  # of the joints that things may hide before a frame is flagged
REFUSED = 0.25  # of what a frame costs that the guard refuses: above it CMA-ES then looks for a view
UNHIDDEN = "the networks lost the person behind something, the next round took no such view"
UNBIASED = f"correction: no bias of the networks is known, it takes {LEAST} frames in which a reading is sure"
UNSEEN = "no correction: the networks see nobody in the render"
UNREAD = "no correction: extract.verify=false reads no render by the networks"
UNAIMED = "no correction: extract.inner=image searches by the networks themselves"


@dataclass(frozen=True)
class Round:
    """What a round goes on from.

    Args:
        take: what the round before found.
        shown: what the networks read of its frames.
        seen: what geometry reads of them.
        off: pitch bias already taken off this round's target, (N,) [rad].
    """

    take: Take
    shown: Features
    seen: Features
    off: Tensor  # (N,)


@dataclass(frozen=True)
class Attempt:
    """One round of search and reading back.

    Args:
        found: each frame's minimum.
        cameras: N, of the path taken, at the output size.
        path: its order; None where every frame was left as it was found.
        shown: its frames, in the scene as it was given, read and scored.
        doubtful: views that a search must not take, in which things hide part of the person, or that show where the
            scene ends, (N,) bool by reason.
        left_out: what the search did not see, None where it saw everything.
        cuts: frames before which the camera jumps and the reference's does not.
    """

    found: Path
    cameras: Camera
    path: LeastPath | None
    shown: Readback
    doubtful: dict[str, Tensor]  # (N,) each
    left_out: LeftOut | None
    cuts: list[int]

    @property
    def x(self) -> Tensor:
        """The path taken, (N, D)."""
        return self.found.x if self.path is None else self.path.x


def best_of(made: Sequence[Attempt]) -> int:
    """Index of the round with the lowest total, the first of several."""
    return min(range(len(made)), key=lambda i: made[i].shown.scores.total)


def attempts(job: Job, clock: Clock, progress: Progress) -> tuple[list[Attempt], str]:
    """Rounds of search and reading back, and what is to be told of them.

    After the first, a search is aimed off the networks' bias; once, where they lost the person behind something, it
    takes no view of which that is true instead. Where that was of no use, it goes on from the round before.
    """
    asked = job.config.extract.corrections if job.reference.family == "image" else 0
    why_none = _why_uncorrected(job) if asked else ""
    rounds = 0 if why_none else asked
    by, stage = job, replace(job.stage, scene=job.solid)
    target, starts, reference, made = job.wanted, job.starts, job.reference, list[Attempt]()
    before: Round | None = None
    aimed: Take | None = None
    none = off = torch.zeros(len(job.reference), dtype=torch.float64)
    lost_in, note = -1, why_none
    for number in range(rounds + 1):
        step = f"frames, round {number + 1}" if rounds else "frames"
        report = _counting(progress, step, len(job.reference))
        if aimed is not None:
            progress(f"{step}: the path of the round before", 0, 0)
        take = search_path(by, stage, target, starts, report, aimed)
        clock.lap("search")
        shown = read_back(job.stage, job.parts, reference, take.cameras, job.by_networks, progress)
        reference = shown.reference  # what one round had to do without no later one has
        last = number == rounds
        seen = None if last and job.stage.guard is None else read_path(job.stage, take.cameras)
        doubtful = _doubtful(by.stage, seen, job.wanted)
        made.append(Attempt(take.found, take.cameras, take.path, shown, doubtful, take.left_out, take.cuts))
        clock.lap("reading back")
        if last or seen is None:
            break
        now = Round(take, shown.features, seen, off)
        if before is None and _lost_behind_things(job, now):
            before, lost_in = now, number
            by, note = _watchful(job), f"no correction: {UNHIDDEN}"
            stage, target, aimed = replace(by.stage, scene=job.solid), job.wanted, None
            starts, off = _starts(by, stage), none
            continue
        if before is not None and by is not job and best_of(made) <= lost_in:  # of no use
            by, now = job, before
        bias = measure_bias(
            now.shown, now.seen, BIAS_WINDOW if job.config.extract.bias == "robust" else 0.0, job.starting.at
        )
        if bool(nobody(now.shown).all()):
            return made, UNSEEN
        if not bias.known:
            return made, f"no {'further ' if number else ''}{UNBIASED}"
        aimed, stage, first, note = now.take, now.take.clip.stage, now.take.cameras[0], ""
        homes = first if job.config.warm_start else concatenate([first, job.starts.homes])
        target, starts = corrected(job.wanted, bias), Starts(homes, _guide(now, first, bias))
        off = bias.angles[:, 1]
    return made, note


def _guide(now: Round, first: Camera, bias: Bias) -> Guide:
    """The path taken as the guide of a round from its ``first`` camera, as high as its own guide was, less the bias."""
    take = now.take
    pitch = pitch_of(take.clip, take.x) if take.guide is None else take.guide.pitch + now.off - bias.angles[:, 1]
    return Guide(take.clip.about(first, take.x), pitch)


def _why_uncorrected(job: Job) -> str:
    """Why the rounds that the config asks for are not made, empty where they are."""
    if job.config.extract.inner == "image":
        return UNAIMED
    return "" if job.by_networks else UNREAD


def _lost_behind_things(job: Job, now: Round) -> bool:
    """Whether the networks miss the person of a frame in which, by the geometry, things hide joints."""
    missed = nobody(now.shown) & ~nobody(job.reference.features)
    if job.stage.guard is None or not (job.wanted.has("keypoints") and now.seen.has("keypoints")):
        return False
    wanted = job.wanted.require("keypoints")[..., 2] > VISIBLE
    return bool((missed & (hidden_share(now.seen, wanted) > MAY_HIDE)).any())


def _watchful(job: Job) -> Job:
    """A search that takes no view in which things hide many joints, and looks for one where it has none."""
    stage, schedule = job.stage, job.schedule
    assert stage.guard is not None
    limit = REFUSED * _least_lost(job)
    schedule = replace(schedule, basin=min(schedule.basin, limit), rescue=min(schedule.rescue, limit))
    return replace(job, stage=replace(stage, guard=replace(stage.guard, hidden=MAY_HIDE)), schedule=schedule)


def _least_lost(job: Job) -> float:
    """The least that a frame costs which shows the person and of which no view may be taken; none costs inf."""
    objective = job.stage.objective
    defined = objective.defined(job.wanted)
    lost = objective.totals(torch.full(defined.shape, math.nan, dtype=torch.float64), defined)
    told = lost[~nobody(job.wanted) & (lost > 0)]
    return float(told.min()) if len(told) else math.inf


def _starts(job: Job, stage: Stage) -> Starts:
    """Where to start by the guard of ``stage``; where before if it allows nothing."""
    try:
        return job.starting.starts(stage, job.wanted)
    except NoViewError:
        return job.starts


def _counting(progress: Progress, step: str, count: int) -> FrameDone:
    def report(frame: int, solved: Solved) -> None:
        progress(step, frame + 1, count)
        if frame + 1 == count:
            progress(f"{step}: the path", 0, 0)  # through them, of which nobody knows how long it takes

    return report


def _doubtful(stage: Stage, seen: Features | None, reference: Features) -> dict[str, Tensor]:
    if stage.guard is None or seen is None:
        return {}
    told = replace(stage.guard, hidden=min(stage.guard.hidden, TOLD)).reasons(seen, reference)
    return {**told, SCENE_ENDS: shows_end(seen, stage.scene.up)}
