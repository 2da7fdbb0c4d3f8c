"""Along the clip: a path that is one motion is one in the search's parameters too."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import torch
from torch import Tensor

from cltransfer.camera import Camera, concatenate
from cltransfer.config import load_config
from cltransfer.driver.closed_form import closed_form
from cltransfer.driver.follow import Path as Followed
from cltransfer.driver.follow import follow
from cltransfer.driver.frame import Memory, Solved, solve
from cltransfer.driver.initial_view import any_view
from cltransfer.driver.problem import Problem
from cltransfer.driver.schedule import Schedule, make_schedule
from cltransfer.driver.stage import Stage, read_path
from cltransfer.driver.whole_clip import WholeClip
from cltransfer.features import Features
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.objective import Objective
from cltransfer.scenes.load import load_scene
from cltransfer.search.subject_orbit import SubjectOrbit
from cltransfer.shots import builtin_reference, shot
from cltransfer.subject import Subject
from cltransfer.trajectory import Trajectory
from cltransfer.transfer import Inputs, transfer

PLACED = ("preset=fast", "losses.filmic_space=null", "losses.camera_movement=null")
MOTION = tuple(f"losses.{name}=null" for name in ("shot_size", "framing", "filmic_space", "camera_angle"))
SIZE = (96, 54)
PERSON, BACKGROUND = 1, 2  # of layers


class Job(NamedTuple):
    stage: Stage
    search: SubjectOrbit
    schedule: Schedule


def ended(*totals: float, nobody: tuple[int, ...] = ()) -> Followed:
    """A path whose frames ended so, but for those that show nobody."""
    x, eye = torch.zeros(len(totals), 1), torch.zeros(len(totals), 3)
    frames = [Solved(x[0], total, 0, "carried" if i in nobody else "worth", Memory()) for i, total in enumerate(totals)]
    camera = Camera.look_at(eye, eye + torch.eye(3)[0], torch.eye(3)[1], 0.7, SIZE)
    return Followed(x, camera, tuple(frames))


@pytest.mark.parametrize(
    ("totals", "leaps"),
    [
        ((0.1,) * 11 + (3.1,), True),
        ((0.1,) * 11 + (2.9,), False),  # a lean way is good enough up to about this
        ((0.6,) * 11 + (3.5,), False),  # no worse than many
        ((0.5,) * 11 + (3.5,), True),
    ],
)
def test_a_path_leaps_where_a_frame_ends_far_above_the_others(totals: tuple[float, ...], leaps: bool) -> None:
    found = ended(*totals)
    assert found.leaps(found.totals) == leaps


@pytest.mark.parametrize(("lost", "leaps"), [(4, False), (5, False), (6, True)])
def test_no_path_leaps_where_nobody_is_seen_nor_right_after(lost: int, leaps: bool) -> None:
    found = ended(*(8.0 if i == lost else 0.1 for i in range(12)), nobody=(3, 4))
    assert found.leaps(found.totals) == leaps


@pytest.mark.parametrize(("nobody", "drifts"), [((), True), ((7, 8, 9, 10, 11), False), (tuple(range(12)), False)])
def test_a_path_drifts_where_its_end_is_far_worse_but_not_where_nobody_is_seen(
    nobody: tuple[int, ...], drifts: bool
) -> None:
    assert ended(*(0.1,) * 8, *(3.0,) * 4, nobody=nobody).drifts == drifts


def test_a_guide_from_behind_is_not_left_by_a_whole_turn() -> None:
    config, scene = load_config(overrides=PLACED), load_scene("builtin:plaza")
    parts, search = Components.build(config), SubjectOrbit()
    objective = Objective(parts.losses)
    stage = Stage(scene, parts.renderer, parts.plan("scene"), objective, SIZE)
    view = any_view(scene.subject, SIZE)
    guide = search.vector(view, view, scene.subject).repeat(8, 1)
    guide[:, 0] = 3.15 + 0.01 * torch.arange(8)  # a vector of a camera there has -3.13
    wanted = guide.clone()
    wanted[:, 0] += torch.linspace(0.06, -0.05, 8)  # so that the guide leads best to some frames and not to others
    reference = read_path(stage, search.cameras(wanted, view, scene.subject))
    homes = search.cameras(guide[:1], view, scene.subject)
    schedule = make_schedule(config, search, objective, reference)
    found = follow(WholeClip(stage, search, reference, homes[0]), homes, schedule, guide=guide[:, :6])
    assert float((found.x[:, 0] - wanted[:, 0]).abs().max()) < 0.05


@pytest.mark.parametrize(("name", "most"), [("pan", 0.2), ("orbit", 0.8)])  # metres
def test_where_only_motion_is_known_each_frame_goes_on_from_the_one_before(
    name: str, most: float, tmp_path: Path
) -> None:
    true = builtin_reference(name, SIZE, 8)[1]
    Trajectory(true.camera[:1], true.times[:1]).save(tmp_path / "view.json")
    small = ("preset=fast", "frames=8", "search_side=96", "output_side=96", "threads=1", "extract.verify=false")
    given = Inputs("builtin:plaza", f"builtin:{name}", str(tmp_path / "view.json"))
    found = transfer(given, load_config(overrides=[*small, *MOTION]))
    away = (found.trajectory.camera.center - true.camera.center).norm(dim=1)
    assert float(away.max()) < most  # each from the view that was given they are 1.4 and more away


@pytest.fixture
def late() -> Callable[..., tuple[Job, Features, Tensor]]:
    """A shot of the plaza, taught to the plaza, whose first frames show nobody; its reference and true vectors."""

    def run(name: str, frames: int, unseen: int) -> tuple[Job, Features, Tensor]:
        scene = load_scene("builtin:plaza")
        assert scene.subject is not None
        config, true = load_config(overrides=["preset=fast"]), shot(name, scene.subject, SIZE, frames)
        parts, search = Components.build(config), SubjectOrbit()
        stage = Stage(scene, parts.renderer, parts.plan("scene"), Objective(parts.losses), SIZE)
        read = read_path(stage, true.camera)
        keypoints, orientation = read.require("keypoints").clone(), read.require("orientation").clone()
        subject, layers = read.require("subject").clone(), read.require("layers").clone()
        keypoints[:unseen] = orientation[:unseen] = torch.nan
        subject[:unseen] = False
        layers[:unseen, BACKGROUND] |= layers[:unseen, PERSON]
        layers[:unseen, PERSON] = False
        gone = {"keypoints": keypoints, "orientation": orientation, "subject": subject, "layers": layers}
        job = Job(stage, search, make_schedule(config, search, stage.objective, read))
        return job, replace(read, **gone), search.vector(true.camera, true.camera[0], scene.subject)

    return run


def led(job: Job, reference: Features) -> tuple[Tensor, Camera, Subject]:
    """A path in closed form, its first view, and whom it shows."""
    subject = job.stage.scene.subject
    assert subject is not None
    home = any_view(subject, SIZE)
    guide = closed_form(WholeClip(job.stage, job.search, reference, home), True, 4)
    assert guide is not None
    return guide.x, job.search.cameras(guide.x[:1], home, subject), subject


@pytest.mark.parametrize(("name", "view"), [("orbit", "behind"), ("tilt", "guide")])
def test_before_anybody_is_seen_the_guide_leads_and_not_the_view_that_was_given(
    late: Callable[..., tuple[Job, Features, Tensor]], name: str, view: str
) -> None:
    job, reference, true = late(name, 12, 4)
    guide, homes, subject = led(job, reference)
    if view == "behind":
        eye = subject.anchor - 3 * subject.facing
        behind = Camera.look_at(eye[None], subject.anchor[None], subject.up, 0.7, SIZE)
        homes = concatenate([behind, homes])
    found = follow(WholeClip(job.stage, job.search, reference, homes[0]), homes, job.schedule, guide=guide)
    assert float((found.x[4:, :3] - true[4:, :3]).abs().max()) < 0.1
    assert float((found.x[4:, 4:6] - true[4:, 4:6]).abs().max()) < 0.05
    assert float(found.x[1:, 0].sub(found.x[:-1, 0]).abs().max()) < 0.2  # rad


def test_a_first_frame_that_shows_nobody_makes_none_of_the_next_far_worse_than_usual(
    late: Callable[..., tuple[Job, Features, Tensor]],
) -> None:
    job, reference, _ = late("truck", 6, 1)
    guide, homes, _ = led(job, reference)
    frames = follow(WholeClip(job.stage, job.search, reference, homes[0]), homes, job.schedule, guide=guide).frames
    totals = [frame.total for frame in frames]
    assert totals[0] == 0 < totals[2] < totals[1]  # better than the only one before it that shows somebody
    assert [frame.memory.renewal.wait for frame in frames] == [1] * 6  # no Jacobian was measured afresh in vain
    assert frames[-1].memory.totals == tuple(totals[1:])


def test_a_steady_move_goes_on_as_fast_however_the_frames_of_its_clip_are_spaced() -> None:
    scene, config, search = load_scene("builtin:plaza"), load_config(overrides=["preset=fast"]), SubjectOrbit()
    parts, at = Components.build(config), torch.tensor([0, 1, 2, 6, 7, 11, 12, 16, 17], dtype=torch.float64)
    stage = Stage(scene, parts.renderer, parts.plan("scene"), Objective(parts.losses), SIZE)
    home = any_view(scene.subject, SIZE)
    true = search.vector(home, home, scene.subject).repeat(len(at), 1)
    true[:, 0] += 0.05 * at  # round the person
    reference = read_path(stage, search.cameras(true, home, scene.subject))
    schedule = make_schedule(config, search, stage.objective, reference)
    before = stage.spent.evaluations
    found = follow(WholeClip(stage, search, reference, home, at), home, schedule)
    assert stage.spent.evaluations - before < 42  # 50 where the last step is taken again whatever time passes
    assert float((found.x - true).abs().max()) < 0.01


def test_a_shot_that_stands_still_is_searched_once_and_stands(
    late: Callable[..., tuple[Job, Features, Tensor]],
) -> None:
    job, reference, _ = late("static", 8, 2)
    assert job.schedule.still
    guide, homes, _ = led(job, reference)
    before = job.stage.spent.evaluations
    clip = WholeClip(job.stage, job.search, reference, homes[0])
    progress: list[int] = []

    def told(frame: int, found: Solved) -> None:
        progress.append(job.stage.spent.evaluations - before)

    found = follow(clip, homes, job.schedule, told, guide)
    assert [frame.stop for frame in found.frames[3:]] == ["as before"] * 5
    assert torch.equal(found.x[3:], found.x[2:3].expand(5, -1))
    assert progress[-1] - progress[2] <= 2  # what the flow is, and what it stays
    assert found.local is not None
    assert found.local.total == pytest.approx(clip.total(found.x), abs=1e-6)


def test_a_shot_that_stands_still_is_searched_once_by_cma_es_too(
    late: Callable[..., tuple[Job, Features, Tensor]],
) -> None:
    job, reference, _ = late("static", 8, 2)
    guide, homes, _ = led(job, reference)
    schedule = replace(job.schedule, engine="cma", budget=replace(job.schedule.budget, generations=4))
    found = follow(WholeClip(job.stage, job.search, reference, homes[0]), homes, schedule, guide=guide)
    assert [frame.generations for frame in found.frames] == [0, 0, 4, 0, 0, 0, 0, 0]
    assert torch.equal(found.x[3:], found.x[2:3].expand(5, -1))


@pytest.mark.parametrize("engine", ["cma", "adam"])
def test_of_a_frame_that_tells_nothing_nothing_is_learned(
    late: Callable[..., tuple[Job, Features, Tensor]], engine: str
) -> None:
    job, reference, _ = late("static", 3, 2)
    home, nothing = any_view(job.stage.scene.subject, SIZE), torch.zeros(len(job.stage.objective.losses)).bool()
    problem = Problem(job.stage, job.search, home, reference[0], None, nothing, True)
    starts, memory = torch.zeros(2, job.search.dimensions, dtype=torch.float64), Memory()
    starts[1, 0] = 0.5
    spent = job.stage.spent.evaluations
    found = solve(problem, starts, memory, replace(job.schedule, engine=engine), np.random.default_rng(0))
    assert torch.equal(found.x, starts[0])
    assert (found.generations, found.memory, job.stage.spent.evaluations) == (0, memory, spent)
