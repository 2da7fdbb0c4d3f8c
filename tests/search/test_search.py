"""Vectors to cameras and back, for every search."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch
from kornia.geometry.conversions import axis_angle_to_rotation_matrix

from cltransfer.camera import Camera
from cltransfer.errors import ModelError
from cltransfer.features import Features
from cltransfer.registry import SEARCHES
from cltransfer.search import check_search
from cltransfer.search.paper_box import PaperBox
from cltransfer.search.subject_orbit import SCALE, SubjectOrbit
from cltransfer.subject import Subject
from cltransfer.testing.samples import sample_subject

SIZE = (160, 90)


def person() -> Subject:
    joints = torch.zeros(14, 3, dtype=torch.float64)
    heights = (1.45, 1.45, 1.15, 1.15, 0.9, 0.9, 0.95, 0.95, 0.5, 0.5, 0.08, 0.08, 1.75, 1.45)
    joints[:, 2] = torch.tensor(heights, dtype=torch.float64)
    joints[:, 1] = torch.tensor([1, -1] * 6 + [0, 0], dtype=torch.float64) * 0.15
    ones = torch.ones(14, dtype=torch.float64)
    facing, up = torch.eye(3, dtype=torch.float64)[[0, 2]]
    return Subject(joints, ones, facing, up, 1.75)


def home(subject: Subject) -> Camera:
    eye = subject.anchor + torch.tensor([4.0, 1.0, 0.3], dtype=torch.float64)
    return Camera.look_at(eye[None], subject.anchor[None], subject.up, 0.8, SIZE)


@pytest.mark.parametrize("name", SEARCHES.names())
def test_vector_inverts_cameras(name: str) -> None:
    subject = person()
    search = SEARCHES.build(name)
    x = torch.rand(20, search.dimensions, generator=torch.Generator().manual_seed(0), dtype=torch.float64) - 0.5
    camera = search.cameras(x, home(subject), subject)
    again = search.cameras(search.vector(camera, home(subject), subject), home(subject), subject)
    torch.testing.assert_close(again.w2c, camera.w2c, atol=1e-9, rtol=0)
    torch.testing.assert_close(again.K, camera.K, atol=1e-7, rtol=0)


@pytest.mark.parametrize("name", SEARCHES.names())
def test_every_search_answers_in_its_own_dimensions(name: str) -> None:
    check_search(SEARCHES.build(name), home(person()), person())


class Wider(SubjectOrbit):
    """One that says it has more than it answers for."""

    dimensions = 8


class Narrower(SubjectOrbit):
    """One whose vectors lack the lens."""

    def vector(self, camera: Camera, home: Camera, subject: Subject | None) -> torch.Tensor:
        return super().vector(camera, home, subject)[:, :-1]


class Plain(SubjectOrbit):
    """One whose vectors are lists."""

    def vector(self, camera: Camera, home: Camera, subject: Subject | None) -> Any:
        return super().vector(camera, home, subject).tolist()


@pytest.mark.parametrize(
    ("search", "line"),
    [
        (Wider(), r"search 'wide': expected low bounds of shape \(8,\), got \(7,\) \(its dimensions are 8\)"),
        (Narrower(), r"search 'wide': expected a vector of shape \(1, 7\), got \(1, 6\)"),
        (Plain(), "search 'wide': expected bounds and vectors that are tensors, it raised AttributeError"),
    ],
)
def test_a_search_that_answers_otherwise_is_named(
    search: SubjectOrbit, line: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(SEARCHES, "name_of", lambda component: "wide")
    with pytest.raises(ModelError, match=line):
        check_search(search, home(person()), person())


@pytest.mark.parametrize("name", SEARCHES.names())
def test_home_is_a_point_of_the_search(name: str) -> None:
    subject = person()
    search, at = SEARCHES.build(name), home(subject)
    again = search.cameras(search.vector(at, at, subject), at, subject)
    torch.testing.assert_close(again.w2c, at.w2c, atol=1e-9, rtol=0)
    torch.testing.assert_close(again.K, at.K, atol=1e-7, rtol=0)


@pytest.mark.parametrize("degrees", [91, 120, 180])
def test_a_camera_that_has_the_person_behind_it_is_turned_to_them_and_not_on_its_head(degrees: float) -> None:
    subject, away = person(), home(person())
    turn, roll = torch.zeros(2, 1, 3, dtype=torch.float64).unbind(0)
    turn[:, 1], roll[:, 2] = math.radians(degrees), 0.3
    w2c = away.w2c.clone()
    w2c[:, :3] = axis_angle_to_rotation_matrix(roll) @ axis_angle_to_rotation_matrix(turn) @ w2c[:, :3]
    camera = Camera(w2c, away.K, away.size)
    assert float(camera.project(subject.anchor[None])[1]) < 0
    x = SubjectOrbit().vector(camera, away, subject)
    again = SubjectOrbit().cameras(x, away, subject)
    torch.testing.assert_close(again.center, camera.center)
    torch.testing.assert_close(again.K, camera.K)
    seen, depth = again.project(subject.anchor[None])
    torch.testing.assert_close(seen[0, 0], torch.tensor(SIZE, dtype=torch.float64) / 2)
    assert float(depth) > 0
    assert float((x * SCALE)[0, 2]) == pytest.approx(0.3, abs=0.1)  # it leans as the camera that was given does


@pytest.mark.parametrize("name", SEARCHES.names())
def test_without_the_lens_the_focal_length_is_that_of_home(name: str) -> None:
    subject = person()
    search, at = SEARCHES.build(name), home(subject)
    x = torch.rand(5, search.dimensions - 1, generator=torch.Generator().manual_seed(1), dtype=torch.float64) - 0.5
    torch.testing.assert_close(search.cameras(x, at, subject).focal, at.focal.expand(5))


@pytest.mark.parametrize("name", SEARCHES.names())
def test_rotations_are_rotations_over_the_whole_box(name: str) -> None:
    subject = person()
    search, at = SEARCHES.build(name), home(subject)
    low, high = (b.clamp(-4, 4) for b in search.bounds())
    share = torch.rand(100, search.dimensions, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    R = search.cameras(low + share * (high - low), at, subject).w2c[:, :3, :3]
    torch.testing.assert_close(R @ R.transpose(1, 2), torch.eye(3, dtype=R.dtype).expand(100, 3, 3), atol=1e-9, rtol=0)
    assert bool((torch.linalg.det(R) > 0).all())


def test_the_paper_box_prints_the_papers_ranges() -> None:
    subject = person()
    search, at = SEARCHES.build("paper_box"), home(subject)
    corner = torch.tensor([[1.0, -1, 1, 0, 0, 1, 1, 1]], dtype=torch.float64)
    camera = search.cameras(corner, at, subject)
    moved = (camera.center - at.center) @ at.w2c[0, :3, :3].T
    torch.testing.assert_close(moved[0], torch.tensor([5.0, -5.0, 5.0], dtype=torch.float64))
    torch.testing.assert_close(camera.focal, 5 * at.focal)
    turn = at.w2c[0, :3, :3] @ camera.c2w[0, :3, :3]
    assert math.acos((float(turn.trace()) - 1) / 2) == pytest.approx(math.pi / 2)


def test_gamma_zero_is_clamped_where_the_paper_would_divide_by_zero() -> None:
    search, at = SEARCHES.build("paper_box"), home(person())
    x = torch.zeros(1, 8, dtype=torch.float64)
    x[0, 7] = -1
    torch.testing.assert_close(search.cameras(x, at, None).focal, 0.05 * at.focal)


def test_the_orbit_puts_the_subject_where_it_says() -> None:
    subject = person()
    search, at = SEARCHES.build("subject_orbit"), home(subject)
    # azimuth 90 degrees, two heights away, a quarter frame right and a tenth up, apparent size 0.5
    p = torch.tensor([[math.pi / 2, 0.2, 0.0, math.log(2), 0.25, -0.1, math.log(0.5)]], dtype=torch.float64)
    scale = torch.tensor([1.0, 0.6, 0.6, 0.8, 0.4, 0.4, 0.8], dtype=torch.float64)
    camera = search.cameras(p / scale, at, subject)
    pixel, _ = camera.project(subject.anchor[None])
    torch.testing.assert_close(pixel[0, 0], torch.tensor([0.75 * 160, 0.4 * 90], dtype=torch.float64))
    offset = camera.center[0] - subject.anchor
    assert float(offset.norm()) == pytest.approx(2 * subject.height)
    assert float(offset @ subject.left) == pytest.approx(2 * subject.height * math.cos(0.2))
    assert float(camera.focal) == pytest.approx(0.5 * 2 * 90)


def test_the_apparent_size_alone_is_a_zoom_and_the_distance_alone_a_dolly_zoom() -> None:
    subject = person()
    search, at = SEARCHES.build("subject_orbit"), home(subject)
    base = search.vector(at, at, subject).repeat(2, 1)
    zoom = base.clone()
    zoom[1, 6] += 0.5
    assert torch.allclose(*search.cameras(zoom, at, subject).w2c)
    dolly = base.clone()
    dolly[1, 3] += 0.5
    camera = search.cameras(dolly, at, subject)
    ratio = camera.focal / (camera.center - subject.anchor).norm(dim=1)
    torch.testing.assert_close(ratio[0], ratio[1])


@pytest.mark.parametrize(
    ("asked", "given"), [(0.3, 0.35), (0.34, 0.35), (0.36, 0.36), (19.9, 19.9), (20.1, 20.0), (40.0, 20.0)]
)
def test_the_orbit_has_no_wider_and_no_longer_lens_than_it_says(asked: float, given: float) -> None:
    """Focal lengths in frame heights, of a camera three heights away."""
    subject, search = person(), SubjectOrbit()
    p = torch.tensor([[0.2, 0.1, 0.0, math.log(3), 0.0, 0.0, math.log(asked / 3)]], dtype=torch.float64)
    camera = search.cameras(p / SCALE, home(subject), subject)
    assert float(camera.focal) / SIZE[1] == pytest.approx(given)
    assert float((camera.center - subject.anchor).norm()) == pytest.approx(3 * subject.height)
    assert search.limited(p / SCALE).tolist() == [asked != given]
    assert search.limited((p / SCALE)[:, :6]).tolist() == [False]  # it has the lens that is given


def test_the_orbit_says_that_it_needs_a_subject() -> None:
    search = SEARCHES.build("subject_orbit")
    with pytest.raises(ValueError, match="needs a lifted subject"):
        search.cameras(torch.zeros(1, 7), home(person()), None)


def test_a_close_up_of_the_face_lies_within_the_orbit_s_bounds() -> None:
    person = sample_subject()
    face = person.anchor + 0.4 * person.height * person.up
    eye = face + 0.8 * person.height * person.facing
    camera = Camera.look_at(eye[None], face, person.up, 0.12, (160, 90))  # the frame is a tenth of the body high
    low, high = SubjectOrbit().bounds()
    x = SubjectOrbit().vector(camera, camera, person)[0]
    assert bool(((x > low) & (x < high)).all())


def seen_from(at: Camera, subject: Subject, seen: list[int]) -> Features:
    """A frame that shows the joints ``seen`` of the 14, and no others."""
    confidence = torch.zeros(1, 14, 1, dtype=torch.float64)
    confidence[:, seen] = 1.0
    return Features(size=SIZE, keypoints=torch.cat([at.project(subject.joints)[0], confidence], dim=-1))


@pytest.mark.parametrize("seen", [[12, 13, 0], [0, 12, 2, 4, 6]])
def test_joints_of_one_side_tell_the_size_where_fewer_than_two_key_joints_are_seen(seen: list[int]) -> None:
    subject, search = person(), SubjectOrbit()
    at = home(subject)
    true = search.vector(at, at, subject)
    wrong = true.clone()
    wrong[:, 6] += 0.7
    found = search.aimed(wrong, at, subject, seen_from(at, subject, seen))
    torch.testing.assert_close(found, true, atol=2e-2, rtol=0)


def test_joints_of_one_side_tell_the_place_too_where_no_key_joint_is_seen() -> None:
    subject, search = person(), SubjectOrbit()
    at = home(subject)
    true = search.vector(at, at, subject)
    wrong = true + torch.tensor([0, 0, 0, 0, 0.3, -0.2, 0.7], dtype=torch.float64)
    found = search.aimed(wrong, at, subject, seen_from(at, subject, [1, 9, 11]))
    torch.testing.assert_close(found, true, atol=2e-2, rtol=0)


def test_a_single_joint_tells_the_place_and_no_size() -> None:
    subject, search = person(), SubjectOrbit()
    at = home(subject)
    wrong = search.vector(at, at, subject) + torch.tensor([0, 0, 0, 0, 0.3, -0.2, 0.7], dtype=torch.float64)
    found = search.aimed(wrong, at, subject, seen_from(at, subject, [9]))
    assert float(found[0, 6]) == float(wrong[0, 6])
    knee = [camera.project(subject.joints[9:10])[0][0, 0] for camera in (at, search.cameras(found, at, subject))]
    torch.testing.assert_close(knee[1], knee[0], atol=0.5, rtol=0)
    assert torch.equal(search.aimed(wrong, at, subject, seen_from(at, subject, [])), wrong)


@pytest.mark.parametrize(("at", "unit"), [(0, 1.0), (2, 0.6)], ids=["azimuth", "roll"])
def test_whole_turns_bring_an_angle_that_wraps_next_to_another(at: int, unit: float) -> None:
    subject, search = person(), SubjectOrbit()
    x = torch.zeros(3, 7, dtype=torch.float64)
    x[:, at] = torch.tensor([-3.13, 0.5, 9.0], dtype=torch.float64) / unit
    to = torch.zeros(7, dtype=torch.float64)
    to[at] = 3.15 / unit
    turned = search.turned(x, to)
    wanted = torch.tensor([2 * math.pi - 3.13, 0.5, 9.0 - 2 * math.pi], dtype=torch.float64) / unit
    torch.testing.assert_close(turned[:, at], wanted)
    others = [k for k in range(7) if k != at]
    assert torch.equal(turned[:, others], x[:, others])
    same = [search.cameras(path, home(subject), subject).w2c for path in (x, turned)]
    torch.testing.assert_close(same[1], same[0])
    assert torch.isinf(search.bounds()[1][at])  # or a path could not go on past it


@pytest.mark.parametrize("option", ["translation", "angle"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan])
def test_a_box_without_room_is_refused(option: str, value: float) -> None:
    """A tripod is no box of width 0: its shares of the half-range would be 0 / 0."""
    with pytest.raises(ValueError, match=f"{option} must be positive, got {value}"):
        PaperBox(**{option: value})
