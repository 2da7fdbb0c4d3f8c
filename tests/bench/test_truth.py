"""Errors against true cameras, on paths that are wrong by a known amount."""

import math

import pytest
import torch
from kornia.geometry.conversions import axis_angle_to_rotation_matrix

from cltransfer.bench.truth import median, path_errors
from cltransfer.camera import Camera, intrinsics
from cltransfer.trajectory import jerk

SIZE = (160, 90)
MOVED = 0.2 * math.sqrt(17.5)  # root mean square distance of _dolly() from its start


def _dolly(count: int = 8, step: float = 0.2, start: float = -6.0) -> Camera:
    z = start + step * torch.arange(count, dtype=torch.float64)
    eye = torch.stack([torch.zeros(count, dtype=torch.float64), torch.zeros(count, dtype=torch.float64), z], 1)
    up = torch.tensor([0.0, -1.0, 0.0])
    return Camera.look_at(eye, eye + torch.tensor([0.0, 0.0, 1.0]), up, 0.7, SIZE)


def _turned(camera: Camera, degrees: list[float]) -> Camera:
    """Each camera turned to its side where it stands."""
    turn = torch.eye(4, dtype=torch.float64).repeat(len(degrees), 1, 1)
    axis = torch.tensor([[0.0, math.radians(angle), 0.0] for angle in degrees], dtype=torch.float64)
    turn[:, :3, :3] = axis_angle_to_rotation_matrix(axis)
    return Camera(turn @ camera.w2c, camera.K, SIZE)


def test_the_true_path_has_no_error():
    errors = path_errors(_dolly(), _dolly(), 2.0)
    assert (errors.position, errors.log_focal, errors.path_position) == pytest.approx((0, 0, 0), abs=1e-9)


def test_a_collinear_path_of_another_scale_and_place_has_the_right_shape():
    errors = path_errors(_dolly(step=0.1, start=-9.0), _dolly(), 2.0)
    assert errors.path_position == pytest.approx(0, abs=1e-9)
    assert errors.position > 1


def test_the_opposite_direction_is_no_matter_of_scale():
    errors = path_errors(_dolly(step=-0.2), _dolly(), 1.0)
    assert errors.path_position == pytest.approx(2 * MOVED)


def test_the_median_of_what_is_infinite_is_infinite_and_of_what_is_undefined_undefined():
    assert median(torch.tensor([math.inf, math.inf])) == math.inf
    assert math.isnan(median(torch.tensor([1.0, math.nan, 3.0])))


def test_of_an_even_number_of_frames_the_median_is_between_the_two_in_the_middle():
    true = _dolly(4)
    moved = true.w2c.clone()
    moved[:, 0, 3] += torch.tensor([0.0, 0.2, 0.6, 0.8], dtype=torch.float64)
    assert path_errors(Camera(moved, true.K, SIZE), true, 1.0).position == pytest.approx(0.4)
    assert path_errors(_turned(true, [1.0, 3.0, 5.0, 9.0]), true, 1.0).rotation == pytest.approx(4, abs=1e-3)


@pytest.mark.parametrize("factor", [1.5, 0.8])
@pytest.mark.parametrize("larger", [1, 2])
def test_position_is_told_in_subject_heights_and_focal_as_a_log_whatever_the_size(factor, larger):
    true, size = _dolly(), (larger * SIZE[0], larger * SIZE[1])
    found = Camera(true.w2c.clone(), intrinsics(true.focal * factor * larger, size), size)
    found.w2c[:, 0, 3] += 0.5
    errors = path_errors(found, true, 2.0)
    assert errors.position == pytest.approx(0.25)
    assert errors.log_focal == pytest.approx(abs(math.log(factor)))
    assert errors.path_position == pytest.approx(0, abs=1e-9)


def test_a_constant_turn_is_an_error_of_rotation_and_not_of_the_path_s():
    true = _dolly()
    errors = path_errors(_turned(true, [5.0] * 8), true, 1.0)
    assert errors.rotation == pytest.approx(5, abs=1e-3)
    assert errors.path_rotation == pytest.approx(0, abs=1e-3)


def test_a_turn_that_grows_is_an_error_of_the_path_s_rotation_from_its_first_frame_on():
    true = _dolly(5)
    errors = path_errors(_turned(true, [3.0, 5.0, 7.0, 9.0, 11.0]), true, 1.0)
    assert errors.rotation == pytest.approx(7, abs=1e-3)
    assert errors.path_rotation == pytest.approx(4, abs=1e-3)


def test_a_standing_camera_has_no_scale():
    errors = path_errors(_dolly(step=0.2), _dolly(step=0.0), 1.0)
    assert errors.path_position == pytest.approx(MOVED)


def test_an_even_move_has_no_jerk_and_a_shaken_one_has():
    assert jerk(_dolly(), 1.0) == pytest.approx(0, abs=1e-9)
    shaken = _dolly()
    shaken.w2c[::2, 0, 3] += 0.01
    assert jerk(shaken, 1.0) == pytest.approx(0.04, rel=1e-6)
    assert math.isnan(jerk(_dolly(3), 1.0))
