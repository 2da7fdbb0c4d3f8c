"""What one search finds: followed again where that is better, and whether a frame of it is lost."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
import torch

from cltransfer.config import load_config
from cltransfer.driver.follow import follow
from cltransfer.driver.frame import Solved
from cltransfer.driver.second_guide import second_guide
from cltransfer.driver.stage import Stage
from cltransfer.driver.starts import Starts
from cltransfer.driver.whole_clip import WholeClip
from cltransfer.features import Features
from cltransfer.progress import silent
from cltransfer.run.inputs import Inputs
from cltransfer.run.preparation import Clock, Job, prepare
from cltransfer.run.take import Take, _followed_again, led_on, searched


def quiet(frame: int, solved: Solved) -> None:
    """Hears how far a search is."""


def test_whether_a_frame_is_lost_is_told_by_the_path_where_there_is_one() -> None:
    config = load_config(overrides=["preset=fast", "frames=2", "search_side=48", "output_side=96"])
    job = prepare(Inputs("builtin:plaza", "builtin:push_in"), config, Clock(), silent, None)
    take = searched(job, replace(job.stage, scene=job.solid), job.wanted, job.starts, quiet)
    assert take.guide is job.starts.guide
    assert take.path is not None
    assert take.path.residuals is not None
    far = torch.zeros_like(take.path.residuals)
    far[0] = 10.0
    through = replace(take, path=replace(take.path, residuals=far))
    assert not take.leaps
    assert through.leaps
    lost = replace(through.found, frames=tuple(replace(f, total=30.0 * i) for i, f in enumerate(through.found.frames)))
    assert replace(take, found=lost, path=None).leaps
    assert not replace(take, found=lost).leaps  # the path passes it by


@pytest.mark.parametrize("worse", ["DRIFT", "LEAP"])
def test_a_clip_that_was_lost_leanly_is_followed_thoroughly_too_and_the_better_is_taken(
    monkeypatch: pytest.MonkeyPatch, worse: str
) -> None:
    """Where its last frames ended worse than the first, or one leaps: here by any difference."""
    config = load_config(overrides=["frames=3", "search_side=48", "output_side=96", "threads=1"])
    job, heard = prepare(Inputs("builtin:plaza", "builtin:push_in"), config, Clock(), silent, None), list[int]()
    stage, thoroughly = replace(job.stage, scene=job.solid), replace(job.schedule, lean_limit=0.0)

    def total(job: Job) -> float:
        heard.clear()
        return searched(job, stage, job.wanted, job.starts, lambda frame, _: heard.append(frame)).total

    lean, thorough = total(job), total(replace(job, schedule=thoroughly))
    assert lean < 0.95 * thorough
    assert heard == [0, 1, 2]
    monkeypatch.setattr(f"cltransfer.driver.follow.{worse}", 0.0)
    monkeypatch.setattr(f"cltransfer.driver.follow.{worse}_FLOOR", 0.0)
    assert total(job) == pytest.approx(lean)
    assert heard == 2 * [0, 1, 2]


FLOW = ["frames=8", "search_side=96", "output_side=96", "threads=1", "losses.camera_movement.weight=80"]
NEARER, TREMBLES = slice(0, 5), 0.1  # frames; [rad]


@pytest.fixture
def astray() -> tuple[Job, Stage, Starts]:
    """An orbit whose frames are left where the guide has them: five too near, and flow wrong at any distance."""
    job = prepare(Inputs("builtin:plaza", "builtin:orbit"), load_config(overrides=FLOW), Clock(), silent, None)
    stays = replace(job.schedule.refinement, steps=0)
    schedule = replace(job.schedule, refinement=stays, lean_limit=0.0, basin=math.inf, rescue=math.inf)
    assert job.starts.guide is not None
    guide, stage = job.starts.guide.x.clone(), replace(job.stage, scene=job.solid)
    guide[NEARER, 3] -= 0.5
    guide[NEARER, 0] += TREMBLES * torch.tensor([1.0, -1.0, 1.0, -1.0, 1.0])
    clip = WholeClip(stage, job.search, job.wanted, job.starts.homes[0])
    return replace(job, schedule=schedule), stage, Starts(clip.cameras(guide[:1]), replace(job.starts.guide, x=guide))


def test_a_second_guide_is_held_against_totals_in_which_flow_has_its_whole_weight(
    astray: tuple[Job, Stage, Starts],
) -> None:
    job, stage, starts = astray
    clip = WholeClip(stage, job.search, job.wanted, starts.homes[0])
    found = follow(clip, starts.homes, job.schedule, quiet, starts.guide.x)
    assert found.local is not None
    assert starts.guide is not None
    again = second_guide(clip, starts.guide, found.x, found.totals)
    assert again is not None
    whole = clip.totals(found.local.residuals)
    torch.testing.assert_close(whole, clip.totals(clip.residuals(found.x)))
    assert not again.gains(clip, found.x, found.totals)  # half the weight, by which each frame was searched
    assert again.gains(clip, found.x, whole)
    farther = _followed_again(clip, job.schedule, starts, quiet, found)
    assert float((farther.x - found.x)[NEARER, 3].min()) > 0.4


def test_how_well_a_clip_was_followed_leanly_is_told_by_the_frames_that_show_somebody(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Half of them cost nothing from anywhere: with as many more the limit would be twice as high."""
    config = load_config(overrides=["preset=fast", "frames=4", "search_side=48", "output_side=96", "threads=1"])
    job, heard = prepare(Inputs("builtin:plaza", "builtin:push_in"), config, Clock(), silent, None), list[int]()
    gone = {name: job.wanted.require(name).clone() for name in ("keypoints", "subject", "layers", "orientation")}
    for value in gone.values():
        value[2:] = False if value.dtype == torch.bool else torch.nan
    target, stage = replace(job.wanted, **gone), replace(job.stage, scene=job.solid)
    clip = WholeClip(stage, job.search, target, job.starts.homes[0], job.starting.at)
    assert clip.placed_share == 0.5
    assert job.starts.guide is not None
    lean = follow(clip, job.starts.homes, job.schedule.lean, quiet, job.starts.guide.x)
    assert lean.local is not None
    monkeypatch.setattr("cltransfer.driver.follow.DRIFT_FLOOR", math.inf)
    for share, times in ((1.9, 2), (2.1, 1)):  # of its total, as the limit of frames that are all told
        schedule = replace(job.schedule, lean_limit=share * lean.local.total)
        heard.clear()
        searched(replace(job, schedule=schedule), stage, target, job.starts, lambda frame, _: heard.append(frame))
        assert len(heard) == times * len(target)


BIAS = 0.02  # [frame heights] and [rad] that networks read too low and too high, steadily


@pytest.fixture(scope="module")
def first() -> tuple[Job, Take]:
    """A push in that shakes as if networks had read it, and what a first round found for it."""
    config = load_config(overrides=["preset=fast", "frames=6", "search_side=96", "output_side=96", "threads=1"])
    job = replace(prepare(Inputs("builtin:courtyard", "builtin:push_in"), config, Clock(), silent, None), noise=0.1)
    return job, searched(job, replace(job.stage, scene=job.solid), job.wanted, job.starts, quiet)


def aimed_off(job: Job, take: Take, joints: torch.Tensor) -> tuple[Features, Starts]:
    """The target with ``joints``, (N,) or less, in frame heights, taken off, and where the second round starts."""
    keypoints = job.wanted.require("keypoints").clone()
    keypoints[..., 1] -= (joints * job.wanted.size[1])[:, None]
    orientation = job.wanted.require("orientation") - torch.tensor([0.0, BIAS, 0.0])
    target = job.wanted.having("keypoints", keypoints).having("orientation", orientation)
    assert take.guide is not None
    return target, Starts(take.cameras[0], replace(take.guide, x=take.x))


def test_a_steady_bias_is_aimed_off_by_the_path_as_a_whole(first: tuple[Job, Take]) -> None:
    """Within what counts as the same, by fewer than half of the evaluations, and no frame is searched."""
    job, take = first
    target, starts = aimed_off(job, take, torch.full((len(job.wanted),), BIAS))
    spent, cost = job.stage.spent, list[int]()
    before = spent.evaluations
    led = led_on(job, take.clip.stage, target, starts, take)
    cost.append(spent.evaluations - before)
    anew = searched(job, take.clip.stage, target, starts, quiet)
    cost.append(spent.evaluations - before - cost[0])
    assert led is not None
    assert led.path is not None
    assert led.path.total <= anew.total + led.path.floor
    assert led.path.total < led.path.free - led.path.floor, "as it was it would have missed the target"
    assert cost[0] < 0.5 * cost[1]
    assert led.found is take.found


def test_what_no_path_as_a_whole_meets_is_searched_anew(first: tuple[Job, Take]) -> None:
    job, take = first
    shakes = 0.2 * torch.tensor([1.0, -1.0] * (len(job.wanted) // 2))
    assert led_on(job, take.clip.stage, *aimed_off(job, take, shakes), take) is None


@pytest.mark.parametrize("asked", [{"joint": 0}, {"warm_start": False}], ids=str)
def test_a_path_is_led_on_only_where_paths_are_refined_and_frames_start_from_others(
    asked: dict[str, Any], first: tuple[Job, Take]
) -> None:
    job, take = first
    target, starts = aimed_off(job, take, torch.zeros(len(job.wanted)))
    assert led_on(job, take.clip.stage, target, starts, take) is not None
    other = replace(job, config=replace(job.config, **asked))
    assert led_on(other, take.clip.stage, target, starts, take) is None


@pytest.mark.parametrize(
    "changed", [None, {"knots": None, "filtered": 0.0}, {"knots": 1}, {"knots": 2}, {"residuals": None}], ids=str
)
def test_neither_frames_as_they_were_found_nor_a_steady_path_is_led_on(
    changed: dict[str, Any] | None, first: tuple[Job, Take]
) -> None:
    job, take = first
    target, starts = aimed_off(job, take, torch.zeros(len(job.wanted)))
    assert take.path is not None
    path = None if changed is None else replace(take.path, **changed)
    assert led_on(job, take.clip.stage, target, starts, replace(take, path=path)) is None
