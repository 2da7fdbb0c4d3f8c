import math

import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.orientation import _turned, orientation_from_axes

UP = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)  # world: z up, the body faces +x, its left is +y
LEFT = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)


def seen_from(eye, camera_up=UP):
    """Orientation by which a camera at ``eye`` that looks at the origin sees the body."""
    camera = Camera.look_at(torch.tensor([eye]), torch.zeros(1, 3), torch.as_tensor(camera_up), 0.8, (64, 48))
    R = camera.w2c[0, :3, :3]
    return orientation_from_axes(R @ LEFT, R @ UP, R @ camera.center[0])


def degrees(*angles):
    return torch.deg2rad(torch.tensor(angles, dtype=torch.float64))


def test_is_zero_for_a_level_camera_in_front_of_the_body():
    torch.testing.assert_close(seen_from([3.0, 0.0, 0.0]), degrees(0, 0, 0))


def test_yaw_is_positive_where_the_camera_stands_on_the_bodys_left():
    torch.testing.assert_close(seen_from([0.0, 2.0, 0.0]), degrees(90, 0, 0))
    torch.testing.assert_close(seen_from([1.0, -1.0, 0.0]), degrees(-45, 0, 0))


def test_pitch_is_positive_from_above():
    torch.testing.assert_close(seen_from([math.sqrt(3), 0.0, 1.0]), degrees(0, 30, 0))
    torch.testing.assert_close(seen_from([0.0, 1.0, -1.0]), degrees(90, -45, 0))


def test_roll_is_positive_when_the_body_leans_right_in_the_image():
    # from the front the image's right is the body's left (+y); a camera tilted to its left sees it lean right
    lean = [0.0, -math.sin(math.radians(20)), math.cos(math.radians(20))]
    torch.testing.assert_close(seen_from([3.0, 0.0, 0.0], lean), degrees(0, 0, 20))


def test_behind_the_body_yaw_is_half_a_turn():
    assert abs(float(seen_from([-3.0, 0.0, 0.0])[0])) == pytest.approx(math.pi)


def test_axes_need_not_be_orthonormal():
    skewed = orientation_from_axes(
        torch.tensor([4.0, 1.0, 0.0]), torch.tensor([0.0, -7.0, 0.0]), torch.tensor([0.0, 0, -2])
    )
    torch.testing.assert_close(skewed, torch.zeros(3))


def test_undefined_axes_are_nan_for_their_body_only():
    left = torch.tensor([[1.0, 0, 0], [0, 0, 0], [math.nan, 0, 0]])
    angles = orientation_from_axes(left, torch.tensor([0.0, -1, 0]).expand(3, 3), torch.tensor([0.0, 0, -1]))
    assert angles[0].isfinite().all()
    assert angles[1:, 0].isnan().all()


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_parallel_axes_have_no_yaw(dtype):
    g = torch.Generator().manual_seed(0)
    up, length = torch.randn(1000, 3, generator=g, dtype=dtype), torch.randn(1000, 1, generator=g, dtype=dtype)
    toward_camera = torch.randn(1000, 3, generator=g, dtype=dtype)
    assert orientation_from_axes(100 * length * up, up, toward_camera)[:, 0].isnan().all()
    aside = torch.linalg.cross(up, toward_camera)
    assert orientation_from_axes(length * up + 1e-3 * aside, up, toward_camera).isfinite().all()


def test_roll_is_read_after_the_least_turn_that_brings_the_body_to_the_middle():
    generator = torch.Generator().manual_seed(1)
    ray, vector = torch.randn(2, 50, 3, generator=generator, dtype=torch.float64)
    ray[:, 2] = ray[:, 2].abs() + 0.1
    ray /= ray.norm(dim=1, keepdim=True)
    middle = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64).expand_as(ray)
    axis = torch.linalg.cross(ray, middle)
    cosine = ray[:, 2:]
    by_rodrigues = (
        vector * cosine + torch.linalg.cross(axis, vector) + axis * (axis * vector).sum(1, keepdim=True) / (1 + cosine)
    )
    torch.testing.assert_close(torch.stack(_turned(vector, ray), dim=1), by_rodrigues[:, :2])
