"""Cameras aimed at a reference: in its own scene they are the true ones, however little of the person they show."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import pytest
import torch
from torch import Tensor

from cltransfer.camera import Camera
from cltransfer.config import load_config
from cltransfer.driver.aiming import LEAD, LEVEL, _bridged, _led, _unturned, aimed_at, aimed_path, pitch_of, stands
from cltransfer.driver.closed_form import DISTANCES, Guide, closed_form
from cltransfer.driver.lookups import STEP
from cltransfer.driver.second_guide import second_guide
from cltransfer.driver.whole_clip import WholeClip
from cltransfer.extractors.scene_orientation import SceneOrientation
from cltransfer.features import Features
from cltransfer.pipeline.plan import Step
from cltransfer.progress import silent
from cltransfer.run.inputs import Inputs
from cltransfer.run.preparation import Clock, prepare
from cltransfer.scenes.load import load_scene
from cltransfer.search.subject_orbit import SCALE
from cltransfer.skeleton import JOINTS
from cltransfer.subject import Subject
from cltransfer.trajectory import Trajectory

CLOSE = 0.42  # of a body height above its middle: the face
Film = Callable[..., WholeClip]


@pytest.fixture(scope="module")
def person() -> Subject:
    subject = load_scene("builtin:plaza").subject
    assert subject is not None
    return subject


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory, person: Subject) -> Film:
    """The plaza filmed from ``eyes`` (N, 3) towards a height above the person's middle, to be taught to the plaza."""

    def run(eyes: Tensor, height: float = CLOSE, about: str = "shown", zoom: str = "fixed", *other: str) -> WholeClip:
        path = tmp_path_factory.mktemp("shot") / "shot.json"
        target = person.anchor + height * person.height * person.up
        true = Camera.look_at(eyes, target, person.up, 0.7, (160, 90))
        Trajectory(true, torch.arange(float(len(eyes)), dtype=torch.float64)).save(path)
        small = ["search_side=96", "output_side=96", "threads=1", "extract.verify=false", f"zoom={zoom}"]
        config = load_config(overrides=[*small, f"extractors.scene_orientation.about={about}", *other])
        job = prepare(Inputs("builtin:plaza", f"builtin:plaza@{path}"), config, Clock(), silent, None)
        return WholeClip(job.stage, job.search, job.wanted, true[0].at_size(job.starts.homes[0].size))

    return run


def in_front(person: Subject, distances: list[float], height: float = CLOSE) -> Tensor:
    """Eyes (N, 3) before the person, so far away and so high above their middle [body heights]."""
    away = torch.tensor(distances, dtype=torch.float64)[:, None] * person.facing
    return person.anchor + person.height * (away + height * person.up)


def off(clip: WholeClip, x: Tensor, person: Subject) -> Tensor:
    """By how much [rad] angles about what is shown are off those that were read, (N,)."""
    cameras = clip.cameras(x)
    read = SceneOrientation("shown")(Features(cameras.size, camera=cameras, person=person), None)
    return (read.require("orientation") - clip.reference.require("orientation"))[:, 1].abs()


@dataclass(frozen=True)
class Labels:
    """A plugin's extractor, whose option of this name is of another thing."""

    about: str = "shown"


def test_an_option_of_another_extractor_says_nothing_of_angles(film: Film, person: Subject) -> None:
    clip = film(in_front(person, [3.0]), about="body")
    plan = clip.stage.plan
    stage = replace(clip.stage, plan=replace(plan, steps=(Step("labels", Labels()), *plan.steps)))
    at_home = clip.search.vector(clip.home, clip.home, person)
    assert pitch_of(replace(clip, stage=stage), at_home).equal(pitch_of(clip, at_home))


@pytest.mark.parametrize("about", ["body", "shown"])
def test_a_close_up_stands_where_what_is_shown_is_seen_as_it_was_read(about: str, film: Film, person: Subject) -> None:
    eyes = in_front(person, [0.5, 0.5])
    clip = film(eyes, about=about)
    guide = closed_form(clip, False, 5)
    assert guide is not None
    torch.testing.assert_close(clip.cameras(guide.x).center, eyes, atol=0.04 * person.height, rtol=0)


def test_the_closest_close_ups_are_level_too_and_none_stands_far_from_its_neighbours(
    film: Film, person: Subject
) -> None:
    clip = film(in_front(person, [0.5, 0.46, 0.42, 0.4, 0.38, 0.34, 0.3]))
    guide = closed_form(clip, False, 5)
    assert guide is not None
    assert float(off(clip, guide.x, person).max()) < LEVEL
    assert float(guide.x[:, 1].diff().abs().max() * SCALE[1]) < 0.15


def test_distances_are_looked_up_from_as_high_as_was_read(film: Film, person: Subject) -> None:
    eyes = in_front(person, [0.6] * 3)
    clip = film(eyes, CLOSE, "shown", "free", "losses.filmic_space.weight=0.1")  # which tells by itself otherwise
    guide = closed_form(clip, True, 1)
    assert guide is not None
    step = float(DISTANCES[STEP] / DISTANCES[0]) - 1
    away = (clip.cameras(guide.x).center - eyes).norm(dim=1) / person.height
    assert float(away.max()) < 2.5 * step


def test_nobody_is_raised_beyond_the_steepest_camera_that_there_is(film: Film, person: Subject) -> None:
    pitch = torch.deg2rad(torch.tensor([76.0, 82, 86, 88, 86, 82, 76], dtype=torch.float64))[:, None]
    eyes = person.anchor + 3 * person.height * (pitch.cos() * person.facing + pitch.sin() * person.up)
    clip = film(eyes, 0.0, "shown", "fixed", "search.subject_orbit.elevation=1.4")
    guide, steepest = closed_form(clip, False, 5), clip.search.elevation
    assert guide is not None
    elevation = guide.x[:, 1] * SCALE[1]
    assert float(elevation.max()) <= math.radians(88) + 0.01
    assert float(off(clip, guide.x, person)[elevation < steepest].max()) < LEVEL


def test_other_distances_are_levelled_anew(film: Film, person: Subject) -> None:
    clip = film(in_front(person, [0.5] * 4), zoom="free")
    guide = closed_form(clip, True, 1)
    assert guide is not None
    read, far = stands(clip), guide.x.clone()
    assert read is not None
    far[:, 3] += math.log(3) / SCALE[3]
    far = aimed_path(clip, far, read[:, 1])
    wrong = far.clone()
    wrong[3] = guide.x[3]
    second = second_guide(clip, Guide(far, read[:, 1]), wrong, torch.tensor([1.0, 1, 1, 0.1], dtype=torch.float64))
    assert second is not None
    assert float(off(clip, second.x, person).max()) < LEVEL


def test_another_distance_is_levelled_to_what_was_read_and_not_to_what_was_reached(film: Film, person: Subject) -> None:
    """A frame that could not be level from where the guide has it may be so from elsewhere."""
    clip = film(in_front(person, [0.5] * 4), zoom="free")
    guide = closed_form(clip, True, 1)
    assert guide is not None
    short = guide.x.clone()
    short[:3, 1] -= 0.3 / SCALE[1]  # where it was not reached
    short[:3, 3] += math.log(3) / SCALE[3]
    second = second_guide(clip, replace(guide, x=short), short, torch.tensor([1.0, 1, 1, 0.1], dtype=torch.float64))
    assert second is not None
    assert float(off(clip, second.x, person).max()) < LEVEL


def test_a_frame_that_shows_only_joints_that_the_scene_lacks_is_bridged(film: Film, person: Subject) -> None:
    clip = film(in_front(person, [3.0, 2.8, 2.6, 2.4, 2.2], 0.0), 0.0)
    arms = [JOINTS.index(f"{side}_{part}") for side in ("left", "right") for part in ("elbow", "wrist")]
    confidence, keypoints = person.confidence.clone(), clip.reference.require("keypoints").clone()
    confidence[arms] = 0
    keypoints[3, [k for k in range(14) if k not in arms], 2] = 0
    reference = replace(clip.reference, keypoints=keypoints)
    assert aimed_at(reference, person).tolist() == [True] * 5
    lacking = replace(person, confidence=confidence)
    assert aimed_at(reference, lacking).tolist() == [frame != 3 for frame in range(5)]
    stage = replace(clip.stage, scene=replace(clip.stage.scene, subject=lacking))
    clip = replace(clip, stage=stage, reference=reference)
    read = stands(clip)
    assert read is not None
    path = aimed_path(clip, torch.nn.functional.pad(read / SCALE[:3], (0, 3)), read[:, 1])
    torch.testing.assert_close(path[3, 3:], (path[2, 3:] + path[4, 3:]) / 2)
    raised = path[:, 1] - read[:, 1] / SCALE[1]
    torch.testing.assert_close(raised[3], (raised[2] + raised[4]) / 2)


def test_who_enters_late_was_on_the_way_before() -> None:
    frames = torch.arange(40, dtype=torch.float64)[:, None]
    moving, known = torch.cat([0.1 * frames, 1 + 0 * frames], dim=1), torch.zeros(40, dtype=torch.bool)
    known[8:] = True
    torch.testing.assert_close(_led(_bridged(moving, known, frames[:, 0]), known, frames[:, 0]), moving)
    known[:30] = False
    led = _led(_bridged(moving, known, frames[:, 0]), known, frames[:, 0])
    torch.testing.assert_close(led[30 - LEAD :], moving[30 - LEAD :])
    assert bool((led[: 30 - LEAD] == led[30 - LEAD]).all())  # what moved so for a second need not have before
    known[:] = False
    known[20] = True
    assert bool((_led(_bridged(moving, known, frames[:, 0]), known, frames[:, 0]) == moving[20]).all())


def test_who_enters_late_comes_at_a_steady_speed_however_frames_are_spaced() -> None:
    at = torch.tensor([0.0, 1, 3, 4, 6, 7, 9, 10, 12], dtype=torch.float64)
    moving, known = 0.1 * at[:, None].expand(9, 2), torch.ones(9, dtype=torch.bool)
    known[:3] = known[5] = False
    torch.testing.assert_close(_led(_bridged(moving, known, at), known, at), moving)


def test_an_orbit_that_passes_behind_the_person_goes_on() -> None:
    yaw = torch.tensor([3.0, 3.1, -3.1, -3.0], dtype=torch.float64)
    unturned = _unturned(torch.stack([yaw, 0 * yaw, 0 * yaw], dim=1), torch.arange(4).double())
    assert unturned is not None
    steps = unturned[:, 0].diff()
    assert 0 < float(steps.min()) <= float(steps.max()) < 0.2
