"""One search, and what becomes of its path in the scene as it was given: past floaters and steps of a loss."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from ..driver.aside import FEW, MANY, as_a_whole, go_aside
from ..driver.joint import Effort
from ..driver.path_order import LeastPath, refined
from ..driver.stage import Stage
from ..driver.starts import NoViewError, Starts
from ..driver.whole_clip import WholeClip, views
from ..features import Features
from .left_out import LeftOut
from .preparation import Job
from .take import FrameDone, Take, led_on, searched

SEEN = 0.05  # total that floaters have to cost before anything is done about them
AMONG = 1  # rounds of refining a path among floaters that cost something, of a preset that refines at all
HIDDEN = 0.25  # total that they have to cost a frame for which the path goes aside
STANDS = 0.25  # total above which a path that stands is tried nearby: a step of a loss may lead down
STEP, STEP_FLOOR = 2.0, 1.5  # times the median, and at least so much, that one costs for which it goes: a loss jumps


def search_path(
    job: Job, stage: Stage, target: Features, starts: Starts, report: FrameDone, before: Take | None = None
) -> Take:
    """Find a path in the scene of ``stage``, and what becomes of it among the floaters that this may lack.

    Args:
        job: what is prepared.
        stage: renders and scores, with or without floaters.
        target: what the losses are to meet, N frames.
        starts: where to begin.
        report: called after each frame.
        before: what the round before found, whose path is led on to ``target`` where that is enough; None searches.
    """
    take = None if before is None else led_on(job, stage, target, starts, before)
    take = searched(job, stage, target, starts, report) if take is None else take
    if stage.scene is job.stage.scene:
        return _nearby(job, _past_steps(job, take))
    kept = _nearby(job, _with_floaters(job, take, report))
    if kept.found is not take.found or kept.path is not take.path:  # what floaters cost that was no score of a result
        job.stage.spent.evaluations += views(take.x)
    return kept


def _with_floaters(job: Job, first: Take, report: FrameDone) -> Take:
    """What was found without floaters, past them; or with them, where that is far worse there and the other gains more.

    A path that only they make good, standing close behind one, is no path for a scene from which they are cleaned.
    """
    before = _left_out(job, first)
    first, left_out = _aside(job, first, before)
    # one that went as a whole may have lost so much alone that the floaters seem to cost little
    stands = first.path is not None and first.path.steady
    if not (replace(left_out, alone=before.alone) if stands else left_out).matters:
        return replace(first, left_out=left_out)
    target = first.clip.reference
    try:
        starts = job.starting.starts(job.stage, target)
    except NoViewError:  # among them no view shows anything: what was found without is what there is
        return replace(first, left_out=left_out)
    second = searched(job, job.stage, target, starts, report)
    there = LeftOut(second.total_in(first.clip.stage), second.total)
    job.stage.spent.evaluations += views(second.x)
    return second if there.better(left_out) else replace(first, left_out=left_out)


def _past_steps(job: Job, take: Take) -> Take:
    """What was found in a scene that has no floaters, past steps of the losses."""
    return take if take.path is None else _aside(job, take, LeftOut(take.total, take.total))[0]


def _nearby(job: Job, take: Take) -> Take:
    """A path that stands at views that hardly differ, of which one tells of all frames, if a step leads down there."""
    path = take.path
    if path is None or path.knots != 1 or not _told(job.stage):
        return take
    whole = replace(take.clip, stage=job.stage)
    among = job.stage.path_residuals(whole.reference, take.cameras, whole.defined)  # not counted, as in _aside
    poor = whole.totals(among) > STANDS
    if not _all_told(whole, poor):
        return take
    x, seen = go_aside(whole, path.x, among, poor, path.about, tries=as_a_whole(len(path.x), stands=True))
    left_out = take.left_out or LeftOut(take.total, whole.mean_total(among))
    moved, found = take, left_out
    if x is not path.x:
        moved, found = _moved(job, take, left_out, replace(path, x=x, residuals=seen, free=left_out.alone, aside=True))
    return moved if take.left_out is None else replace(moved, left_out=found)


def _told(stage: Stage) -> bool:
    """Whether the losses tell each frame's share of a total, without noise."""
    return stage.objective.groups is not None and not stage.plan.passes


def _all_told(clip: WholeClip, frames: Tensor) -> bool:
    """Whether all ``frames`` (N,) bool are, but for those whose reference tells nothing: they cost nothing."""
    return bool((frames | ~clip.placed).all()) and bool(frames.any())


def _aside(job: Job, take: Take, left_out: LeftOut) -> tuple[Take, LeftOut]:
    """The path aside where floaters hide the person or a loss jumps, and refined, if it gains there more than it loses.

    Presets that refine a path but once look for no steps.
    """
    path, clip, stage = take.path, take.clip, job.stage
    several, dearer = job.config.joint > AMONG, left_out.among > left_out.alone + SEEN
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
        if not _all_told(whole, wanted):
            return take, left_out
        tries = as_a_whole(len(path.x) if path.knots == 1 else tries.every)
    x, seen = go_aside(whole, path.x, among, wanted, path.about, path.lens_kept, tries)
    if x is path.x and not dearer:
        return take, left_out
    return _moved(job, take, left_out, replace(path, x=x, residuals=seen, free=left_out.alone, aside=x is not path.x))


def _moved(job: Job, take: Take, left_out: LeftOut, aside: LeastPath) -> tuple[Take, LeftOut]:
    """The path ``aside``, refined or else as it is, if it gains more than it loses."""
    clip, path = take.clip, take.path
    assert path is not None
    whole = replace(clip, stage=job.stage)
    tried = [refined(whole, aside, Effort(min(AMONG, job.config.joint), job.config.joint_steps))]
    tried += [aside] if tried[0].x is not aside.x else []
    for there in tried:
        if there.x is path.x or there.residuals is None:
            continue
        # without floaters it is the scene in which it was scored just now
        residuals = there.residuals if clip.stage.scene is job.stage.scene else clip.residuals(there.x)
        moved = replace(there, residuals=residuals, total=clip.mean_total(residuals), free=path.free)
        found = LeftOut(moved.total, whole.mean_total(there.residuals))
        if found.better(left_out):
            return replace(take, path=moved), found
    return take, left_out


def _left_out(job: Job, take: Take) -> LeftOut:
    """What floaters cost the cameras of ``take``, found in a scene without them."""
    return LeftOut(take.total, take.total_in(job.stage))
