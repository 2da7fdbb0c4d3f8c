"""The angle from the lifted person: signs as Features states them."""

import math
from dataclasses import replace

import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.extractors.scene_orientation import SceneOrientation, _inside
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


HEAD = float(sample_subject().joints[JOINTS.index("head_top")] @ UP - MIDDLE @ UP)  # over the anchor; 0.8 is the face


@pytest.mark.parametrize("aside", [0.0, 2.0])
def test_of_a_body_that_is_shown_whole_either_is_the_same(aside: float) -> None:
    both = [about(what, aside, 6, 0, aim=0.0) for what in ("body", "shown")]
    torch.testing.assert_close(*both, atol=1e-9, rtol=0)
    torch.testing.assert_close(about("auto", aside, 6, 0, aim=0.0), both[0], atol=0, rtol=0)


def test_a_close_up_at_the_height_of_the_face_is_level_by_what_it_shows() -> None:
    body, shown = (math.degrees(float(about(what, 0, 0.6, 0, aim=0.8 * HEAD)[1])) for what in ("body", "shown"))
    assert body > 35
    assert abs(shown) < 8


def test_what_is_shown_goes_over_into_the_body_without_a_step() -> None:
    """From a close-up to all of it: the search takes differences of it."""
    pitch = torch.stack([about("shown", 0, 0.6 * 1.02**i, 0, aim=0.8 * HEAD)[1] for i in range(150)])
    assert float(pitch.diff().abs().max()) < math.radians(1)
    assert float(pitch[-1]) == pytest.approx(float(about("body", 0, 0.6 * 1.02**149, 0, aim=0.8 * HEAD)[1]), abs=1e-6)


def test_a_head_before_the_camera_is_seen_though_the_body_reaches_behind_it() -> None:
    person = sample_subject()
    head = person.joints[JOINTS.index("head_top")]
    camera = Camera.look_at((head - 0.3 * UP)[None], head[None], person.facing, math.radians(60), (64, 36))
    assert float(camera.project(person.joints)[1].amin()) < -1
    seen = Features((64, 36), camera=camera, person=person)
    body, shown = (SceneOrientation(what)(seen, None).require("orientation")[0, 1] for what in ("body", "shown"))
    assert bool(body.isnan())
    assert float(shown) < math.radians(-60)


def test_a_place_counts_half_a_tenth_of_the_height_outside_and_nothing_behind_the_camera() -> None:
    camera = Camera.look_at(MIDDLE[None] + 4, MIDDLE[None], UP, math.radians(90), (64, 36))
    side = 64 / 36
    shown, outside = [(0, 0, 1), (0.99 * side, 0.99, 1)], [(0, 1.2, 1), (0, -1.2, 1), (-side - 0.2, 0, 1), (0, 1.4, 1)]
    behind = [(0, 0, -1), (side, 1, -1)]  # the second would be projected into the corner
    places = torch.tensor([[*shown, *outside, *behind]], dtype=torch.float64)
    inside = _inside(camera, places)[0, :, 0]
    assert inside.tolist() == pytest.approx([1, 1, 0.5, 0.5, 0.5, 1 / (1 + 2**4), 0, 0], abs=1e-9)


def test_of_a_body_of_which_nothing_is_shown_the_whole_counts_though_its_feet_are_behind_the_camera() -> None:
    person, eye = sample_subject(), MIDDLE + torch.tensor([0.0, 4, 0], dtype=torch.float64)
    past = torch.tensor([1, -3e-4, 2e-3], dtype=torch.float64)
    camera = Camera.look_at(eye[None], eye + past, UP, math.radians(40), (64, 36))
    depth = camera.project(person.key_joints[:, :3])[1][0]
    assert float(depth[-1]) < 0 < float(depth[0])
    seen = Features((64, 36), camera=camera, person=person)
    body, shown = (SceneOrientation(what)(seen, None).require("orientation")[0] for what in ("body", "shown"))
    assert bool(body.isfinite().all())
    torch.testing.assert_close(shown, body, atol=1e-9, rtol=0)


def test_what_is_shown_is_the_part_of_the_line_wherever_its_joints_are() -> None:
    """Of a person whose knees are not known the line is as long: each place counts by how much of it is there."""
    person, eye = sample_subject(), MIDDLE + torch.tensor([0.0, 1, 0.3], dtype=torch.float64)
    known = torch.tensor([not name.endswith("knee") for name in JOINTS])
    person = replace(person, confidence=person.confidence * known)
    camera = Camera.look_at(eye[None], MIDDLE[None] + 0.3 * UP, UP, math.radians(40), (64, 36))
    seen = SceneOrientation("shown")(Features((64, 36), camera=camera, person=person), None)
    over = float(seen.require("orientation")[0, 1].tan())  # the eye over the middle, which is 1 from it
    head, feet = person.key_joints[[0, -1], :3]
    line = head + torch.linspace(0, 1, 1001, dtype=torch.float64)[:, None] * (feet - head)
    weight = _inside(camera, camera.to_camera(line))[0, :, 0]
    assert over == pytest.approx(float((eye - line)[:, 2] @ weight / weight.sum()), abs=0.003)


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
