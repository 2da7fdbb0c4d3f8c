"""The angle from the lifted person: signs as Features states them."""

import math
from dataclasses import replace

import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.extractors.scene_orientation import SceneOrientation
from cltransfer.features import Features
from cltransfer.search.subject_orbit import SCALE, SubjectOrbit
from cltransfer.skeleton import JOINTS
from cltransfer.testing import sample_subject

UP = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
MIDDLE = sample_subject().anchor


def seen_from(*offset: float, up: torch.Tensor = UP) -> list[float]:
    """Yaw, pitch, roll [deg] of a camera at ``offset`` from the anchor; the person faces +y, its left is -x."""
    eye = MIDDLE + torch.tensor(offset, dtype=torch.float64)
    camera = Camera.look_at(eye[None], MIDDLE[None], up, math.radians(40), (64, 36))
    got = SceneOrientation()(Features((64, 36), camera=camera, person=sample_subject()), None).orientation
    return got[0].rad2deg().tolist()


@pytest.mark.parametrize(
    ("offset", "expected"),
    [
        ((0, 4, 0), (0, 0, 0)),
        ((-4, 0, 0), (90, 0, 0)),
        ((4, 0, 0), (-90, 0, 0)),
        ((0, 4, 4), (0, 45, 0)),
        ((0, 4, -4), (0, -45, 0)),
        ((-3, -3, 0), (135, 0, 0)),
    ],
)
def test_yaw_grows_to_the_left_and_pitch_upwards(offset: tuple[float, ...], expected: tuple[float, ...]) -> None:
    assert seen_from(*offset) == pytest.approx(expected, abs=1e-5)


def test_roll_is_positive_when_the_body_leans_right() -> None:
    tilt = math.radians(20)
    leaning = seen_from(0, 4, 0, up=torch.tensor([math.sin(tilt), 0, math.cos(tilt)], dtype=torch.float64))
    assert leaning == pytest.approx((0, 0, 20), abs=1e-5)  # seen from +y, +x is on the left: the camera leans left


def test_panning_away_leaves_the_place_of_the_camera() -> None:
    """Yaw and pitch tell where the camera is, not where it looks; framing tells that."""
    eye = MIDDLE + torch.tensor([0.0, 4, 0], dtype=torch.float64)
    aims = MIDDLE + torch.tensor([[0.0, 0, 0], [1.0, 0, 0]], dtype=torch.float64)
    camera = Camera.look_at(eye.expand(2, 3), aims, UP, math.radians(40), (64, 36))
    got = SceneOrientation()(Features((64, 36), camera=camera, person=sample_subject()), None).orientation
    torch.testing.assert_close(got[0], got[1], atol=1e-12, rtol=0)


@pytest.mark.parametrize("roll", [0.0, 0.3, -2.5])
@pytest.mark.parametrize(("x", "y"), [(-0.4, 0.1), (0.25, 0.0), (0.3, -0.45)])
def test_roll_is_that_of_a_camera_turned_to_the_person(roll: float, x: float, y: float) -> None:
    """As the search places cameras, and as networks read a crop: where in the frame the person is changes nothing."""
    person, search = sample_subject(), SubjectOrbit()
    home = Camera.look_at(MIDDLE[None] + 4 * person.facing, MIDDLE[None], person.up, math.radians(40), (64, 36))
    asked = torch.tensor([[0.4, 0.7, roll, 1.2, x, y, -0.4]], dtype=torch.float64) / SCALE
    camera = search.cameras(asked, home, person)
    got = SceneOrientation()(Features((64, 36), camera=camera, person=person), None).orientation
    torch.testing.assert_close(got, asked[:, :3] * SCALE[:3], atol=1e-9, rtol=0)


def test_person_behind_the_camera_is_undefined_row_4() -> None:
    eye = MIDDLE + torch.tensor([0.0, 4, 0], dtype=torch.float64)
    camera = Camera.look_at(eye[None], 2 * eye[None] - MIDDLE, UP, math.radians(40), (64, 36))
    got = SceneOrientation()(Features((64, 36), camera=camera, person=sample_subject()), None).orientation
    assert got.isnan().all()


def about(what: str, *offset: float, aim: float) -> torch.Tensor:
    """Yaw, pitch, roll (3,) [rad] from ``offset`` to the anchor, of a level camera as high as the ``aim`` over it."""
    up = aim * UP
    eye = MIDDLE + torch.tensor(offset, dtype=torch.float64) + up
    camera = Camera.look_at(eye[None], MIDDLE + up, UP, math.radians(40), (64, 36))
    return SceneOrientation(what)(Features((64, 36), camera=camera, person=sample_subject()), None).orientation[0]


HEAD = float(sample_subject().joints[0] @ UP - MIDDLE @ UP)  # over the anchor


@pytest.mark.parametrize("aside", [0.0, 2.0])
def test_of_a_body_that_is_shown_whole_either_is_the_same(aside: float) -> None:
    both = [about(what, aside, 6, 0, aim=0.0) for what in ("body", "shown")]
    torch.testing.assert_close(*both, atol=1e-9, rtol=0)
    torch.testing.assert_close(about("auto", aside, 6, 0, aim=0.0), both[0], atol=0, rtol=0)


def test_a_close_up_at_the_height_of_the_head_is_level_by_what_it_shows() -> None:
    body, shown = (math.degrees(float(about(what, 0, 0.6, 0, aim=0.9 * HEAD)[1])) for what in ("body", "shown"))
    assert body > 35
    assert abs(shown) < 8


def test_what_is_shown_goes_over_into_the_body_without_a_step() -> None:
    """From a close-up to all of it: the search takes differences of it."""
    pitch = torch.stack([about("shown", 0, 0.6 * 1.02**i, 0, aim=0.9 * HEAD)[1] for i in range(150)])
    assert float(pitch.diff().abs().max()) < math.radians(1)
    assert float(pitch[-1]) == pytest.approx(float(about("body", 0, 0.6 * 1.02**149, 0, aim=0.9 * HEAD)[1]), abs=1e-6)


def test_a_head_before_the_camera_is_seen_though_the_body_reaches_behind_it() -> None:
    person = sample_subject()
    head = person.joints[0]
    eye = head + 0.3 * UP + 0.02 * person.facing
    camera = Camera.look_at(eye[None], head[None], person.facing, math.radians(60), (64, 36))
    got = SceneOrientation("shown")(Features((64, 36), camera=camera, person=person), None).orientation
    assert float(got[0, 1]) > math.radians(60)


@pytest.mark.parametrize("known", [["head_top"], ["head_top", "left_shoulder", "right_shoulder"]])
def test_a_person_of_whom_one_place_is_known_is_seen_about_that(known: list[str]) -> None:
    """The head alone, and a chest that a scan has at its place."""
    person = sample_subject()
    joints = person.joints.clone()
    told = [JOINTS.index(name) for name in known]
    joints[told] = joints[told[:1]]
    confidence = torch.zeros(14, dtype=torch.float64)
    confidence[told] = 1
    person = replace(person, joints=joints, confidence=confidence)
    eye = person.anchor + person.height * (person.facing + 0.2 * person.up)
    camera = Camera.look_at(eye[None], person.anchor[None], UP, math.radians(60), (64, 36))
    seen = Features((64, 36), camera=camera, person=person)
    first, second = (
        read(seen, None).require("orientation") for read in (SceneOrientation("body"), SceneOrientation("shown"))
    )
    assert float(first[0, 1]) > 0.1
    torch.testing.assert_close(first, second, rtol=0, atol=1e-9)
