"""A whole path in closed form: from a reference's own scene it is nearly the true one, from a few candidates."""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, ClassVar

import pytest
import torch
from torch import Tensor

from cltransfer.camera import Camera
from cltransfer.config import load_config
from cltransfer.driver.closed_form import DISTANCES, GAINS, SIDES, closed_form
from cltransfer.driver.guard import Guard
from cltransfer.driver.lookups import COARSE, POOR, STEP, cheapest_along
from cltransfer.driver.whole_clip import WholeClip
from cltransfer.features import Features
from cltransfer.orientation import wrap
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.objective import Objective
from cltransfer.progress import silent
from cltransfer.run.inputs import Inputs
from cltransfer.run.preparation import Clock, Job, prepare
from cltransfer.scenes.load import load_scene
from cltransfer.search.subject_orbit import SCALE
from cltransfer.shots import shot
from cltransfer.trajectory import Trajectory

FRAMES = 8


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., tuple[Job, Trajectory]]:
    """A shot in the plaza, ready to be taught to the plaza, and its true cameras; what is spent is each test's own."""

    @cache
    def once(name: str, *overrides: str) -> tuple[Job, Trajectory]:
        subject = load_scene("builtin:plaza").subject
        assert subject is not None
        true, path = shot(name, subject, (160, 90), FRAMES), tmp_path_factory.mktemp("shot") / "shot.json"
        true.save(path)
        small = ["search_side=96", "output_side=96", "threads=1", "extract.verify=false", *overrides]
        inputs = Inputs("builtin:plaza", f"builtin:plaza@{path}")
        return prepare(inputs, load_config(overrides=small), Clock(), silent, None), true

    def run(name: str, *overrides: str) -> tuple[Job, Trajectory]:
        job, true = once(name, *overrides)
        return replace(job, stage=replace(job.stage, spent=copy(job.stage.spent))), true

    return run


def found(job: Job, **features: Any) -> Any:
    reference = replace(job.wanted, **features)
    clip = WholeClip(job.stage, job.search, reference, job.starts.homes[0])
    guide = closed_form(clip, job.schedule.free_lens, 5)
    return None if guide is None else guide.x


@pytest.mark.parametrize("name", ["static", "push_in", "orbit", "zoom", "dolly_zoom"])
def test_the_path_is_that_of_the_true_cameras_to_the_step_of_the_distances(prepared: Any, name: str) -> None:
    job, true = prepared(name)
    assert job.starts.guide is not None
    truth = job.search.vector(true.camera, true.camera[0], job.stage.scene.subject)
    step = float(DISTANCES[STEP] / DISTANCES[0]) - 1
    torch.testing.assert_close(job.starts.guide.x[:, :3], truth[:, :3], atol=0.01, rtol=0)
    assert float((job.starts.guide.x[:, 3] - truth[:, 3]).abs().max()) < 2.5 * step
    torch.testing.assert_close(job.starts.guide.x[:, 4:], truth[:, 4:], atol=0.01, rtol=0)


@pytest.mark.parametrize("lens", ["free", "kept"])
def test_it_is_the_same_from_whatever_view_the_lens_is_taken(prepared: Any, lens: str) -> None:
    job, _ = prepared("push_in", *([] if lens == "free" else ["zoom=fixed"]))
    home, subject = job.starts.homes[0], job.stage.scene.subject
    assert subject is not None
    aside = subject.anchor + subject.height * torch.stack([3 * subject.facing, 80 * subject.facing + 30 * subject.up])
    looks = aside + subject.left + 0.1 * subject.facing  # past the person, and from far away
    usual = found(job)
    for eye, at in zip(aside, looks):
        view = Camera.look_at(eye[None], at[None], subject.up, float(home.vertical_fov[0]), home.size)
        guide = closed_form(WholeClip(job.stage, job.search, job.wanted, view), job.schedule.free_lens, 5)
        assert guide is not None
        torch.testing.assert_close(guide.x, usual, atol=1e-6, rtol=0)


def test_it_costs_half_as_many_evaluations_as_there_are_distances_at_most(prepared: Any) -> None:
    job, _ = prepared("push_in", "guide=3")
    first = len(DISTANCES[::COARSE])
    beside = COARSE // STEP - 1  # on either side
    assert 3 * (first + beside) <= job.stage.spent.evaluations <= 3 * (first + 2 * beside)
    assert first + 2 * beside <= len(DISTANCES[::STEP]) / 2


def test_distances_are_looked_up_once_where_nothing_moves(prepared: Any) -> None:
    job, _ = prepared("static", "guide=5")
    assert job.schedule.still
    assert job.stage.spent.evaluations == len(DISTANCES[::STEP])
    assert job.starts.guide is not None
    torch.testing.assert_close(job.starts.guide.x, found(job), rtol=0, atol=1e-9)


def test_a_single_frame_is_one_that_shows_somebody(prepared: Any) -> None:
    job, _ = prepared("static", "guide=5")
    keypoints, subject = job.wanted.keypoints.clone(), job.wanted.subject.clone()
    keypoints[:2], subject[:2] = torch.nan, False
    layers = job.wanted.layers.clone()
    layers[:2] = False
    late = replace(job.wanted, keypoints=keypoints, subject=subject, layers=layers)
    guide = closed_form(WholeClip(job.stage, job.search, late, job.starts.homes[0]), job.schedule.free_lens, 1)
    assert guide is not None
    assert job.starts.guide is not None
    torch.testing.assert_close(guide.x, job.starts.guide.x, rtol=0, atol=1e-9)


def test_distances_are_looked_up_where_somebody_is_seen_though_it_is_in_between(prepared: Any) -> None:
    job, _ = prepared("push_in")
    gone = {name: job.wanted.require(name).clone() for name in ("keypoints", "subject", "layers")}
    hidden = [0, 2, 4, 5, 7]  # of the whole clip these would be looked up
    gone["keypoints"][hidden], gone["subject"][hidden], gone["layers"][hidden] = torch.nan, False, False
    guide, whole = found(job, **gone), found(job)
    assert guide is not None
    step = float(DISTANCES[STEP] / DISTANCES[0]) - 1
    assert float((guide - whole)[[1, 3, 6], 3].abs().max()) < 2.5 * step


def test_frames_that_show_nobody_take_no_lookups_from_those_that_do(prepared: Any) -> None:
    job, _ = prepared("push_in")
    gone = {name: job.wanted.require(name).clone() for name in ("keypoints", "subject", "layers")}
    gone["keypoints"][5:], gone["subject"][5:], gone["layers"][5:] = torch.nan, False, False
    leaves = replace(job.wanted, **gone)
    paths, spent = [], []
    for reference in (leaves, leaves[torch.arange(5)]):
        before = job.stage.spent.evaluations
        path = closed_form(WholeClip(job.stage, job.search, reference, job.starts.homes[0]), True, 5)
        assert path is not None
        paths.append(path.x[:5])
        spent.append(job.stage.spent.evaluations - before)
    assert spent[0] == spent[1]
    torch.testing.assert_close(paths[0][:4], paths[1][:4], rtol=0, atol=2e-3)  # smoothed over what comes after


@pytest.mark.parametrize(
    "name", [*(pytest.param(n, marks=pytest.mark.slow) for n in ("push_in", "orbit")), "dolly_zoom"]
)
def test_coarsely_and_then_finely_it_is_the_path_of_all_distances(
    prepared: Any, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    job, _ = prepared(name)
    lean, before = found(job), job.stage.spent.evaluations
    monkeypatch.setattr(f"{cheapest_along.__module__}.COARSE", STEP)
    torch.testing.assert_close(lean, found(job), rtol=0, atol=0)
    assert job.stage.spent.evaluations - before == 5 * len(DISTANCES[::STEP])


def test_without_one_the_first_frame_starts_from_the_best_of_an_orbit(prepared: Any) -> None:
    job, true = prepared("push_in", "guide=0")
    assert job.starts.guide is None
    assert job.stage.spent.evaluations > 24  # those of the orbit
    off = (job.starts.homes[0].center - true.camera[0].center).norm() / job.stage.scene.subject.height
    assert float(off) < 0.2


def test_a_kept_lens_leaves_nothing_to_try(prepared: Any) -> None:
    job, _ = prepared("push_in", "zoom=fixed")
    assert job.starts.guide is not None
    assert job.starts.guide.x.shape == (FRAMES, 6)
    assert job.stage.spent.evaluations == 0


def test_a_frame_that_was_not_read_is_taken_from_those_around_it(prepared: Any) -> None:
    job, _ = prepared("push_in")
    orientation, keypoints = (job.wanted.require(n).clone() for n in ("orientation", "keypoints"))
    orientation[3], keypoints[3] = torch.nan, torch.nan
    guide = found(job, orientation=orientation, keypoints=keypoints)
    torch.testing.assert_close(guide[3], (guide[2] + guide[4]) / 2, atol=0.02, rtol=0)
    assert torch.isfinite(guide).all()


def test_what_is_read_of_where_a_camera_stands_is_held_before_it_is_known(prepared: Any) -> None:
    """It is noisy: the difference of two readings, twelve times over, would turn a camera that stands still."""
    job, _ = prepared("static")
    orientation = job.wanted.require("orientation").clone()
    orientation[:3] = torch.nan
    orientation[3] += 0.1
    guide = found(job, orientation=orientation)
    torch.testing.assert_close(guide[:3, :3], guide[3, :3].expand(3, 3))


@pytest.mark.parametrize("name", ["orientation", "keypoints"])
def test_there_is_none_where_nothing_was_read(prepared: Any, name: str) -> None:
    job, _ = prepared("static")
    assert found(job, **{name: None}) is None
    assert found(job, **{name: torch.full_like(job.wanted.require(name), torch.nan)}) is None


def test_there_is_none_where_no_camera_shows_anything(prepared: Any) -> None:
    """All of them stand right before the wall, by the size of a giant."""
    job, _ = prepared("static")
    assert found(replace(job, stage=replace(job.stage, guard=Guard(1e9)))) is None


def test_there_is_none_for_a_search_of_other_parameters(prepared: Any) -> None:
    job, _ = prepared("static", "search={subject_orbit: null, paper_box: {}}")
    assert job.starts.guide is None


@dataclass(frozen=True)
class FromAside:
    """What costs less from aside by azimuth and elevation [rad]; one that is ``blind`` sees nothing from any side."""

    by: tuple[float, float]
    straight: float
    gain: float
    blind: bool = False
    weight: float = 1.0

    requires: ClassVar[tuple[str, ...]] = ("orientation",)
    unit: ClassVar[str] = "1"
    penalty: ClassVar[float] = 100.0

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        turned = wrap(rendered.require("orientation") - reference.require("orientation"))[:, :2]
        there = ((turned - torch.tensor(self.by)).abs() < 0.1).all(1)
        straight = (turned.abs() < 0.1).all(1)
        cost = torch.where(there, self.straight - self.gain, self.straight)
        return cost.masked_fill(~straight, torch.nan) if self.blind else cost


@pytest.mark.parametrize(
    ("by", "straight", "gain", "blind", "goes"),
    [
        *((by, POOR + 1, GAINS + 0.05, False, True) for by in SIDES),
        (SIDES[0], POOR + 1, GAINS - 0.05, False, False),
        (SIDES[1], POOR - 0.05, GAINS + 0.05, False, False),  # good enough where it was read
        (SIDES[2], POOR + 1, GAINS + 0.05, True, False),
    ],
)
def test_a_path_that_is_poor_is_taken_from_the_side_that_gains_enough(
    prepared: Any, by: tuple[float, float], straight: float, gain: float, blind: bool, goes: bool
) -> None:
    job, _ = prepared("static")
    parts = replace(Components.build(load_config()), losses={"aside": FromAside(by, straight, gain, blind)})
    stage = replace(job.stage, plan=parts.plan("scene"), objective=Objective(parts.losses), guard=None)
    guide = closed_form(WholeClip(stage, job.search, job.wanted, job.starts.homes[0]), True, 1)
    assert guide is not None
    moved = torch.tensor(by if goes else (0.0, 0.0), dtype=torch.float64).expand(FRAMES, 2)
    read = job.wanted.require("orientation").double()
    torch.testing.assert_close(guide.x[:, :2] * SCALE[:2] - read[:, :2], moved, atol=1e-6, rtol=0)
    torch.testing.assert_close(guide.pitch - read[:, 1], moved[:, 1], atol=1e-6, rtol=0)
