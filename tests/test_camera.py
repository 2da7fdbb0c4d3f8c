"""One convention inside; every border tested against values worked out by hand."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

from cltransfer.camera import Camera, concatenate, in_one_frame, intrinsics

SIZE = (200, 100)


def looking(eye: list[float], target: list[float], up: list[float], fov: float = math.pi / 2) -> Camera:
    to = lambda v: torch.tensor(v, dtype=torch.float64)  # noqa: E731
    return Camera.look_at(to([eye]), to([target]), to(up), fov, SIZE)


def test_a_point_ahead_projects_to_the_middle_and_right_is_right() -> None:
    camera = looking([0, 0, -2], [0, 0, 0], [0, -1, 0])  # identity rotation: y down, z forward
    torch.testing.assert_close(camera.w2c[0, :3, :3], torch.eye(3, dtype=torch.float64))
    pixels, depth = camera.project(torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]))
    # focal = 100 / (2 tan 45 deg) = 50 px; 1 unit at depth 2 is 25 px
    expected = torch.tensor([[100.0, 50], [125, 50], [100, 75]], dtype=torch.float64)
    torch.testing.assert_close(pixels[0], expected)
    torch.testing.assert_close(depth[0], torch.full((3,), 2.0, dtype=torch.float64))


def test_unproject_inverts_project() -> None:
    camera = looking([3, 1, -4], [0, 0.5, 0], [0, 0, 1])
    points = torch.randn(1, 7, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    pixels, depth = camera.project(points)
    torch.testing.assert_close(camera.unproject(pixels, depth), points)


def test_center_is_where_the_camera_stands() -> None:
    camera = looking([3, 1, -4], [0, 0.5, 0], [0, 0, 1])
    torch.testing.assert_close(camera.center[0], torch.tensor([3.0, 1, -4], dtype=torch.float64))
    torch.testing.assert_close(camera.c2w[0, :3, 3], camera.center[0])


def test_gradients_reach_where_a_camera_looks_from_at_what_and_how_wide() -> None:
    eye = torch.tensor([[3.0, 1, -4], [2, 0, 5]], dtype=torch.float64, requires_grad=True)
    target = torch.tensor([[0.0, 0.5, 0], [0.1, 0, 0]], dtype=torch.float64, requires_grad=True)
    fov = torch.tensor([0.7, 0.9], dtype=torch.float64, requires_grad=True)
    up, points = torch.tensor([0.0, 0, 1]), torch.tensor([[0.3, 0.2, 0.1], [-0.2, 0.4, 0]])

    def seen(eye: torch.Tensor, target: torch.Tensor, fov: torch.Tensor) -> tuple[torch.Tensor, ...]:
        return Camera.look_at(eye, target, up, fov, SIZE).project(points)

    assert torch.autograd.gradcheck(seen, (eye, target, fov))


def test_a_resized_camera_sees_a_point_at_the_same_place_of_the_frame() -> None:
    camera = looking([3, 1, -4], [0, 0.5, 0], [0, 0, 1])
    point = torch.tensor([[0.3, 0.2, 0.1]])
    small, large = camera.project(point)[0], camera.at_size((1000, 300)).project(point)[0]
    scale = torch.tensor([1000 / 200, 300 / 100], dtype=torch.float64)
    torch.testing.assert_close(small * scale, large)


def test_opengl_poses_are_flipped_at_the_border_only() -> None:
    # OpenGL identity looks along -z with y up: in our axes it looks along world -z, its x stays right
    w2c = torch.diag(torch.tensor([1.0, -1, -1, 1], dtype=torch.float64))[None]
    camera = Camera(w2c, intrinsics(torch.tensor([50.0]), SIZE), SIZE)
    pixels, depth = camera.project(torch.tensor([[0.0, 0, -2], [0, 1, -2]]))
    torch.testing.assert_close(depth[0], torch.full((2,), 2.0, dtype=torch.float64))
    torch.testing.assert_close(pixels[0, 1], torch.tensor([100.0, 25], dtype=torch.float64))  # y up is up
    torch.testing.assert_close(camera.to_opengl(), torch.eye(4, dtype=torch.float64)[None])


def test_vertical_field_of_view_comes_back() -> None:
    assert float(looking([0, 0, -2], [0, 0, 0], [0, -1, 0], 0.7).vertical_fov) == pytest.approx(0.7)


def test_a_missing_batch_dimension_is_named() -> None:
    with pytest.raises(ValueError, match=r"w2c must be \(B, 4, 4\), got \(4, 4\); add a batch dimension"):
        Camera(torch.eye(4), torch.eye(3)[None], SIZE)


@pytest.mark.parametrize("size", [(0, 3), (64.0, 36.0), [64, 36], None, (64,)])
def test_a_size_is_two_whole_numbers_of_pixels(size: Any) -> None:
    with pytest.raises(ValueError, match=r"size must be \(W, H\), two whole numbers above 0, got"):
        Camera(torch.eye(4)[None], torch.eye(3)[None], size)


@pytest.mark.parametrize("name", ["w2c", "K"])
@pytest.mark.parametrize("kind", [list, np.asarray])
def test_what_is_no_tensor_is_told_how_it_becomes_one(name: str, kind: Callable[[Any], Any]) -> None:
    given = {"w2c": torch.eye(4)[None], "K": torch.eye(3)[None]}
    with pytest.raises(TypeError, match=rf"{name} must be a tensor \(B, .*torch.as_tensor makes one"):
        Camera(**{**given, name: kind(given[name])}, size=SIZE)


def test_indexing_keeps_the_batch_and_concatenate_joins() -> None:
    camera = concatenate([looking([0, 0, -k], [0, 0, 0], [0, -1, 0]) for k in (1, 2, 3)])
    assert len(camera[1]) == 1
    torch.testing.assert_close(camera[1].center[0, 2], torch.tensor(-2.0, dtype=torch.float64))
    with pytest.raises(ValueError, match="share one size"):
        concatenate([camera, camera.at_size((10, 10))])


def test_a_wide_and_a_high_view_in_one_frame_see_what_they_saw_as_large() -> None:
    points = torch.tensor([[-1.7, 0.0, 0.0], [1.7, 0.9, 0.0], [0.0, -1.9, 0.0]])
    wide = looking([0, 0, -2], [0, 0, 0], [0, -1, 0])
    high = Camera(wide.w2c, intrinsics(wide.focal, (100, 200)), (100, 200))
    both = in_one_frame([wide, high], [(100, 50), (50, 100)])
    assert (len(both), both.size) == (2, (100, 100))
    pixels, _ = both.project(points)
    for index, camera in enumerate((wide, high)):
        alone, _ = camera.project(points)
        middle = torch.tensor([camera.size[0] / 2, camera.size[1] / 2], dtype=torch.float64)
        torch.testing.assert_close(pixels[index] - 50, (alone[0] - middle) / 2)
        seen = ((alone[0] >= 0) & (alone[0] <= 2 * middle)).all(1)
        assert bool(((pixels[index] >= 0) & (pixels[index] <= 100)).all(1)[seen].all())


def test_views_in_one_frame_see_as_much_on_either_side_more_and_all_else_where_it_was() -> None:
    points = torch.tensor([[-0.7, 0.2, 0.0], [0.4, -0.6, 0.3]])
    camera = looking([0, 0, -2], [0, 0, 0], [0, -1, 0])
    K = camera.K * torch.tensor([[1.3], [1.0], [1.0]]) + torch.tensor([[0, 0, -50.0], [0, 0, 20.0], [0, 0, 0]])
    off = Camera(camera.w2c, K, SIZE)
    both = in_one_frame([off, looking([0, 0, -2], [0, 0, 0], [0, -1, 0])], [(100, 50), (100, 80)])
    pixels, _ = both.project(points)
    torch.testing.assert_close(pixels[0], off.project(points)[0][0] / 2 + pixels.new_tensor([0.0, 15.0]))


def test_a_camera_of_torch_s_default_type_is_kept_as_float64() -> None:
    camera = looking([1.0, 2.0, 3.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    made = Camera(camera.w2c.float(), camera.K.float(), SIZE)
    assert (made.w2c.dtype, made.K.dtype) == (torch.float64, torch.float64)
    torch.testing.assert_close(made.center, camera.center, rtol=0, atol=1e-6)


@pytest.mark.parametrize("eye", [[0.0, 0, 5], [0.0, 0, 0]], ids=["along up", "from where it looks"])
def test_a_view_that_has_no_direction_is_undefined(eye: list[float]) -> None:
    assert looking(eye, [0, 0, 0], [0, 0, 1]).w2c[:, :3, :3].isnan().any()
    assert looking([0, 3, 5], [0, 0, 0], [0, 0, 1]).w2c.isfinite().all()


def test_no_cameras_see_no_points() -> None:
    none = looking([0, 0, 5], [0, 0, 0], [0, 1, 0])[[]]
    assert none.to_camera(torch.zeros(4, 3)).shape == (0, 4, 3)


def test_cameras_are_kept_on_the_cpu_whatever_they_are_made_of() -> None:
    elsewhere = torch.eye(4, device="meta")[None], torch.eye(3, device="meta")[None]
    with pytest.raises(NotImplementedError, match="meta"):  # which has nothing to bring
        Camera(*elsewhere, SIZE)


def test_cameras_are_told_apart_by_which_they_are() -> None:
    one, other = (looking([0, 0, 5], [0, 0, 0], [0, 1, 0]) for _ in range(2))
    assert one == one
    assert one != other
    assert other in [one, other]
    assert len({one, other}) == 2
