"""One search: a clip followed leanly or thoroughly, the path through it, and that past floaters and steps of a loss."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..camera import Camera, concatenate
from ..config.options import RunConfig
from ..driver.aside import FEW, MANY, as_a_whole, go_aside
from ..driver.follow import Path, follow
from ..driver.frame import Solved
from ..driver.joint import Effort
from ..driver.path_order import LeastPath, least_path, refined
from ..driver.schedule import Schedule
from ..driver.second_guide import second_guide
from ..driver.stage import Stage
from ..driver.starts import Starts
from ..driver.whole_clip import WholeClip, views
from ..features import Features
from .left_out import LeftOut
from .preparation import Job

Report = Callable[[int, Solved], None]

SEEN = 0.05  # total that floaters have to cost before anything is done about them
AMONG = 1  # rounds of refining a path among floaters that cost something, of a preset that refines at all
HIDDEN = 0.25  # total that they have to cost a frame for which the path goes aside
STANDS = 0.25  # total above which a path that stands is tried nearby: a step of a loss may lead down
STEP, STEP_FLOOR = 2.0, 1.5  # times the median, and at least so much, that one costs for which it goes: a loss jumps


@dataclass(frozen=True)
class Take:
    """What one search found.

    Args:
        clip: what was searched.
        found: each frame's minimum.
        path: its order; None where every frame was left as it was found.
        left_out: what the search did not see, None where it saw everything.
    """

    clip: WholeClip
    found: Path
    path: LeastPath | None
    left_out: LeftOut | None = None

    @property
    def x(self) -> Tensor:
        """The path taken, (N, D)."""
        return self.found.x if self.path is None else self.path.x

    @property
    def cameras(self) -> Camera:
        """N cameras of the path taken, at the output size."""
        return self.found.camera if self.path is None else self.clip.cameras(self.path.x)

    @property
    def total(self) -> float:
        """Mean total in the scene that was searched, of all weights; a view that is blocked pays every penalty."""
        return _total(self, self.clip.stage) if self.path is None else self.path.total

    @property
    def leaps(self) -> bool:
        """Whether a frame of the path taken costs far more than the others."""
        told = None if self.path is None else self.path.residuals
        return self.found.leaps(self.found.totals if told is None else self.clip.totals(told))


def search_path(job: Job, config: RunConfig, stage: Stage, target: Features, starts: Starts, report: Report) -> Take:
    """Find a path in the scene of ``stage``, and what becomes of it among the floaters that this may lack.

    Args:
        job: what is prepared.
        config: of the run.
        stage: renders and scores, with or without floaters.
        target: what the losses are to meet, N frames.
        starts: where to begin.
        report: called after each frame.
    """
    take = _searched(job, config, stage, target, starts, report)
    if stage.scene is job.stage.scene:
        return _nearby(job, config, _past_steps(job, config, take))
    kept = _nearby(job, config, _with_floaters(job, config, take, report))
    if kept.found is not take.found or kept.path is not take.path:  # what floaters cost that was no score of a result
        job.stage.spent.evaluations += views(take.x)
    return kept


def _with_floaters(job: Job, config: RunConfig, first: Take, report: Report) -> Take:
    """What was found without floaters, past them; or with them, where that is far worse there and the other gains more.

    A path that only they make good, standing close behind one, is no path for a scene from which they are cleaned.
    """
    before = _left_out(job, first)
    first, left_out = _aside(job, config, first, before)
    # one that went as a whole may have lost so much alone that the floaters seem to cost little
    stands = first.path is not None and first.path.steady
    if not (replace(left_out, alone=before.alone) if stands else left_out).matters:
        return replace(first, left_out=left_out)
    target = first.clip.reference
    second = _searched(job, config, job.stage, target, job.starting.starts(job.stage, target), report)
    there = LeftOut(job.floaters, _total(second, first.clip.stage), second.total)
    job.stage.spent.evaluations += views(second.x)
    return second if there.better(left_out) else replace(first, left_out=left_out)


def _past_steps(job: Job, config: RunConfig, take: Take) -> Take:
    """What was found in a scene that has no floaters, past steps of the losses."""
    return take if take.path is None else _aside(job, config, take, LeftOut(0, take.total, take.total))[0]


def _nearby(job: Job, config: RunConfig, take: Take) -> Take:
    """A path that stands at views that hardly differ, of which one tells of all frames, if a step leads down there."""
    path = take.path
    if path is None or path.knots != 1 or not _told(job.stage):
        return take
    whole = replace(take.clip, stage=job.stage)
    among = job.stage.path_residuals(whole.reference, take.cameras, whole.defined)  # not counted, as in _aside
    poor = whole.totals(among) > STANDS
    if not bool(poor.all()):
        return take
    x, seen = go_aside(whole, path.x, among, poor, path.about, tries=as_a_whole(len(path.x), stands=True))
    left_out = take.left_out or LeftOut(0, take.total, whole.mean_total(among))
    moved, found = take, left_out
    if x is not path.x:
        moved, found = _moved(
            job, config, take, left_out, replace(path, x=x, residuals=seen, free=left_out.alone, aside=True)
        )
    return moved if take.left_out is None else replace(moved, left_out=found)


def _told(stage: Stage) -> bool:
    """Whether the losses tell each frame's share of a total, without noise."""
    return stage.objective.groups is not None and not stage.plan.passes


def _aside(job: Job, config: RunConfig, take: Take, left_out: LeftOut) -> tuple[Take, LeftOut]:
    """The path aside where floaters hide the person or a loss jumps, and refined, if it gains there more than it loses.

    Presets that refine a path but once look for no steps.
    """
    path, clip, stage = take.path, take.clip, job.stage
    several, dearer = config.joint > AMONG, left_out.among > left_out.alone + SEEN
    if path is None or not _told(stage) or not (several or dearer):
        return take, left_out
    whole = replace(clip, stage=stage)
    # the views of left_out once more, so not counted again
    among = stage.path_residuals(clip.reference, take.cameras, clip.defined)
    totals = whole.totals(among)
    wanted = torch.zeros_like(totals, dtype=torch.bool)
    if dearer:
        wanted |= totals - clip.totals(clip.residuals(path.x) if path.residuals is None else path.residuals) > HIDDEN
    if several:
        wanted |= totals > max(STEP_FLOOR, STEP * float(totals.median()))
    tries = MANY if several else FEW
    if path.steady:  # it goes as a whole or not at all; of one that stands all frames are the same
        if not bool(wanted.all()):
            return take, left_out
        tries = as_a_whole(len(path.x) if path.knots == 1 else tries.every)
    x, seen = go_aside(whole, path.x, among, wanted, path.about, path.lens_kept, tries)
    if x is path.x and not dearer:
        return take, left_out
    return _moved(
        job, config, take, left_out, replace(path, x=x, residuals=seen, free=left_out.alone, aside=x is not path.x)
    )


def _moved(job: Job, config: RunConfig, take: Take, left_out: LeftOut, aside: LeastPath) -> tuple[Take, LeftOut]:
    """The path ``aside``, refined or else as it is, if it gains more than it loses."""
    clip, path = take.clip, take.path
    assert path is not None
    whole = replace(clip, stage=job.stage)
    tried = [refined(whole, aside, Effort(min(AMONG, config.joint), config.joint_steps))]
    tried += [aside] if tried[0].x is not aside.x else []
    for there in tried:
        if there.x is path.x or there.residuals is None:
            continue
        residuals = clip.residuals(there.x)
        moved = replace(there, residuals=residuals, total=clip.mean_total(residuals), free=path.free)
        found = LeftOut(left_out.count, moved.total, whole.mean_total(there.residuals))
        if found.better(left_out):
            return replace(take, path=moved), found
    return take, left_out


def _left_out(job: Job, take: Take) -> LeftOut:
    """What floaters cost the cameras of ``take``, found in a scene without them."""
    return LeftOut(job.floaters, take.total, _total(take, job.stage))


def _total(take: Take, stage: Stage) -> float:
    """Mean total of what was found, in the scene of ``stage``; a view that is blocked there pays every penalty.

    Not counted as evaluations: of what is kept it is its score, as it is rendered for every result; where something
    else is kept :func:`search_path` counts it.
    """
    terms = stage.path_terms(take.clip.reference, take.cameras, guarded=True)
    return float(stage.objective.totals(terms, take.clip.defined).mean())


def _searched(job: Job, config: RunConfig, stage: Stage, target: Features, starts: Starts, report: Report) -> Take:
    """The frames of one round, and the path through them where one is asked for.

    The clip is followed leanly where that is good enough, else thoroughly too. Frames lost on the way tell nothing as
    long as the path passes them by; where it does not, there is a path through either, and the better one is taken.
    """
    clip = WholeClip(stage, job.search, target, starts.homes[0], job.starting.at)
    among, schedule = replace(clip, stage=stage.reduced(clip.home, config.lod)), job.schedule

    def taken(found: Path) -> Take:
        found = _followed_again(among, job.schedule, starts, report, found)
        return Take(clip, found, None if config.path == "exact" else _least(job, config, clip, found, starts.guide))

    if not schedule.lean_limit or schedule.engine != "refine" or not schedule.warm:
        return taken(follow(among, starts.homes, schedule, report, starts.guide))
    first = follow(among, starts.homes, schedule.lean, report, starts.guide)
    if first.local is None:
        return taken(first)
    poor = first.local.total > schedule.lean_limit or first.drifts
    if not poor:
        lean = taken(first)
        if not lean.leaps:
            return lean
    second = follow(among, starts.homes, schedule, report, starts.guide)
    return taken(_better(first, second)) if poor else min(lean, taken(second), key=lambda take: take.total)


def _least(job: Job, config: RunConfig, clip: WholeClip, found: Path, guide: Tensor | None) -> LeastPath:
    local = found.local
    if local is not None and config.lod > 0:  # merged, the scene has other residuals
        local = replace(local, residuals=clip.residuals(found.x))
    return least_path(clip, found.x, local, job.noise, Effort(config.joint, config.joint_steps), guide)


def _followed_again(clip: WholeClip, schedule: Schedule, starts: Starts, report: Report, found: Path) -> Path:
    """Once more at other distances, where part of ``found`` ended right and the rest would cost less at its own."""
    if found.local is None or starts.guide is None or clip.stage.scene.subject is None:
        return found
    again = second_guide(clip, starts.guide, found.x, found.totals)
    if again is None or not again.gains(clip, found.x, clip.totals(found.local.residuals)):
        return found
    homes = concatenate([starts.homes, again.first_views(clip)])
    return _better(found, follow(clip, homes, schedule.lean, report, again.x))


def _better(first: Path, second: Path) -> Path:
    assert first.local is not None
    return second if second.local is not None and second.local.total < first.local.total else first
