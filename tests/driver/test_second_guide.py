"""Frames that ended right tell the others how far away they stand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from cltransfer.config import load_config
from cltransfer.driver.second_guide import NEAR, SecondGuide, second_guide
from cltransfer.driver.whole_clip import WholeClip
from cltransfer.progress import silent
from cltransfer.run.inputs import Inputs
from cltransfer.run.preparation import Clock, Job, prepare
from cltransfer.scenes.load import load_scene
from cltransfer.search.paper_box import PaperBox
from cltransfer.shots import shot

FRAMES = 8
FAR = 0.5  # log of a ratio of distances in the units of x: a half more


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Job:
    """A pan in the plaza, ready to be taught to the plaza."""
    folder: Path = tmp_path_factory.mktemp("shot")
    subject = load_scene("builtin:plaza").subject
    assert subject is not None
    shot("pan", subject, (160, 90), FRAMES).save(folder / "shot.json")
    small = ["search_side=96", "output_side=96", "threads=1", "extract.verify=false"]
    inputs = Inputs("builtin:plaza", f"builtin:plaza@{folder / 'shot.json'}")
    return prepare(inputs, load_config(overrides=small), Clock(), silent, None)


def clip(job: Job) -> WholeClip:
    """What is searched."""
    return WholeClip(job.stage, job.search, job.wanted, job.starts.homes[0])


def second(job: Job, totals: list[float], x: Tensor | None = None) -> SecondGuide | None:
    """The second guide of frames that ended at ``totals``, at x or else where the first guide is."""
    assert job.starts.guide is not None
    found = job.starts.guide.x if x is None else x
    return second_guide(clip(job), job.starts.guide, found, torch.tensor(totals, dtype=torch.float64))


def astray(job: Job, frames: slice) -> Tensor:
    """The guide, but some frames stand too far away."""
    assert job.starts.guide is not None
    x = job.starts.guide.x.clone()
    x[frames, 3] += FAR
    return x


def test_wrong_frames_get_the_distance_of_the_nearest_right_one(job: Job) -> None:
    x = astray(job, slice(0, 3))
    found = second(job, [1.0] * 3 + [0.1] * 5, x)
    assert found is not None
    torch.testing.assert_close(found.x[:3, 3], x[3, 3].expand(3))
    torch.testing.assert_close(found.x[3:], job.starts.guide.x[3:], atol=1e-5, rtol=0)  # type: ignore[index]


def test_a_frame_that_hides_the_person_tells_nothing(job: Job) -> None:
    totals = [1.0] * 3 + [0.1] * 5
    x = astray(job, slice(0, 3))
    x[3, 3] -= FAR
    keypoints = job.wanted.require("keypoints").clone()
    keypoints[3] = torch.nan
    found = second(replace(job, wanted=replace(job.wanted, keypoints=keypoints)), totals, x)
    assert found is not None
    torch.testing.assert_close(found.x[:4, 3], x[4, 3].expand(4), atol=0.02, rtol=0)


def test_an_eighth_of_the_frames_tells_the_others(job: Job) -> None:
    """A guide that leads astray soon is followed rightly for a few frames alone."""
    x = astray(job, slice(1, FRAMES))
    found = second(job, [0.1] + [1.0] * 7, x)
    assert found is not None
    torch.testing.assert_close(found.x[:, 3], x[0, 3].expand(FRAMES))


def test_between_right_ones_they_get_what_is_between(job: Job) -> None:
    x = astray(job, slice(3, 5))
    x[5:, 3] -= FAR / 5
    found = second(job, [0.1] * 3 + [1.0] * 2 + [0.1] * 3, x)
    assert found is not None
    torch.testing.assert_close(found.x[3:5, 3], x[2, 3] + torch.tensor([1, 2]).double() / 3 * (x[5, 3] - x[2, 3]))


def test_every_frame_is_aimed_anew_from_there(job: Job) -> None:
    found = second(job, [1.0] * 3 + [0.1] * 5, astray(job, slice(0, 3)))
    assert found is not None
    subject = job.stage.scene.subject
    aimed = [job.search.aimed(found.x[i : i + 1], job.starts.homes[0], subject, job.wanted[i]) for i in range(FRAMES)]
    torch.testing.assert_close(torch.cat(aimed), found.x, atol=1e-6, rtol=0)


def test_the_first_frame_is_tried_nearer_and_farther_too(job: Job) -> None:
    found = second(job, [1.0] * 3 + [0.1] * 5, astray(job, slice(0, 3)))
    assert found is not None
    views, subject = found.first_views(clip(job)), job.stage.scene.subject
    assert subject is not None
    away = (views.center - subject.anchor).norm(dim=1)
    ratios = (away / away[0]).log()
    torch.testing.assert_close(ratios, torch.tensor([0, NEAR, -NEAR]).double(), atol=0.01, rtol=0)
    assert float(views.focal[1] / views.focal[0]) > 1.03  # farther away with a longer lens: as large as before


def test_it_is_worth_following_where_the_wrong_frames_cost_less_there(job: Job) -> None:
    x = astray(job, slice(0, 3))
    found = second(job, [1.0] * 3 + [0.1] * 5, x)
    assert found is not None
    assert found.wrong.tolist() == [True] * 3 + [False] * 5
    before = job.stage.spent.evaluations
    assert found.gains(clip(job), x, clip(job).totals(clip(job).residuals(x)))
    assert job.stage.spent.evaluations - before == 3 * 3 + FRAMES  # of the wrong ones alone, and the path itself
    there = clip(job).totals(clip(job).residuals(found.x))
    assert not found.gains(clip(job), x, 0.5 * there)  # what was found is better than anything there


def test_there_is_none_where_it_would_tell_nothing(job: Job) -> None:
    x = astray(job, slice(0, 3))
    assert second(job, [1.0] * 8, x) is None  # none is right
    assert second(job, [0.4] * 3 + [0.1] * 5, x) is None  # none is far off
    assert second(job, [1.0] * 3 + [0.1] * 5) is None  # they stand where the right ones do


def test_a_search_that_cannot_aim_or_keeps_the_lens_has_none(job: Job) -> None:
    assert second(job, [1.0] * 3 + [0.1] * 5, astray(job, slice(0, 3))[:, :6]) is None
    totals = [1.0] * 3 + [0.1] * 5
    assert second(replace(job, search=PaperBox()), totals, astray(job, slice(0, 3))) is None
    unread = replace(job, wanted=replace(job.wanted, keypoints=None))
    assert second(unread, totals, astray(job, slice(0, 3))) is None
