"""Flow of a static scene: the kernel against its readable twin, and cases known by hand."""

import math

import pytest
import torch
from kornia.utils import create_meshgrid
from torch import Tensor

from cltransfer.camera import Camera
from cltransfer.extractors.scene_flow import SceneFlow, backward_flow
from cltransfer.features import Features
from cltransfer.testing import sample_cameras

SIZE = (64, 36)
UP = torch.tensor([0.0, -1.0, 0.0])


def cameras_at(*eyes: tuple[float, float, float], target: tuple[float, float, float] | None = None) -> Camera:
    """Cameras that look along +z (or at ``target``), x to the right."""
    eye = torch.tensor(eyes)
    aim = eye + torch.tensor([0.0, 0, 1]) if target is None else torch.tensor([target])
    return Camera.look_at(eye, aim, UP, math.radians(60), SIZE)


def depth_map(seed: int, batch: int, height: int = 36, width: int = 64) -> torch.Tensor:
    depth = torch.rand(batch, height, width, generator=torch.Generator().manual_seed(seed)) * 5 + 1
    depth[:, ::7, ::5] = torch.nan
    return depth


def backward_flow_by_points(depth: Tensor, now: Camera, before: Camera) -> Tensor:
    """The same as ``backward_flow`` by way of the world points: slower, and readable."""
    batch, height, width = depth.shape
    scale = depth.new_tensor([now.size[0] / width, now.size[1] / height]).double()
    grid = create_meshgrid(height, width, normalized_coordinates=False, dtype=torch.float64)  # integer-centred
    pixels = ((grid + 0.5) * scale).reshape(1, -1, 2).expand(batch, -1, 2)
    points = now.unproject(pixels, depth.flatten(1))
    moved, ahead = before.project(points)
    flow = (moved - pixels).masked_fill(~(ahead > 0)[..., None], float("nan"))
    return flow.transpose(1, 2).unflatten(-1, (height, width)).float()


@pytest.mark.parametrize("shape", [(36, 64), (18, 32), (20, 50)])
@pytest.mark.parametrize("shared", [True, False])
def test_kernel_is_its_readable_twin(shape: tuple[int, int], shared: bool) -> None:
    now, before, depth = sample_cameras(1, 3), sample_cameras(2, 3), depth_map(3, 3, *shape)
    before = before[0] if shared else before
    fast, plain = (f(depth, now, before) for f in (backward_flow, backward_flow_by_points))
    assert fast.shape == (3, 2, *shape)
    torch.testing.assert_close(fast, plain, rtol=1e-5, atol=1e-4, equal_nan=True)


@pytest.mark.parametrize("form", [backward_flow, backward_flow_by_points])
def test_point_behind_the_camera_before_is_undefined(form: object) -> None:
    now, before = cameras_at((0, 0, 0)), cameras_at((0, 0, 3.0))
    depth = torch.full((1, 4, 4), 2.0)
    depth[:, :, 2:] = 4.0
    undefined = form(depth, now, before).isnan().all(1)
    assert torch.equal(undefined, depth < 3)


def test_one_camera_a_depth_map_is_asked_for() -> None:
    with pytest.raises(ValueError, match="got 2 maps and 1 cameras"):
        backward_flow(depth_map(0, 2), sample_cameras(1, 1), sample_cameras(1, 1))


def test_sideways_camera_moves_points_by_focal_over_depth() -> None:
    now, before = cameras_at((0.1, 0, 0)), cameras_at((0, 0, 0))
    depth = depth_map(0, 1)
    flow = backward_flow(depth, now, before)
    expected = torch.where(depth.isnan(), torch.nan, float(now.focal) * 0.1 / depth)
    torch.testing.assert_close(flow[:, 0], expected, rtol=1e-4, atol=1e-4, equal_nan=True)
    torch.testing.assert_close(flow[:, 1], expected * 0, rtol=0, atol=1e-4, equal_nan=True)


def test_rotation_alone_does_not_see_depth() -> None:
    now, before = cameras_at((0, 0, 0)), cameras_at((0, 0, 0), target=(0.2, 0.1, 1))
    near, far = torch.full((1, 36, 64), 1.0), torch.full((1, 36, 64), 50.0)
    torch.testing.assert_close(backward_flow(near, now, before), backward_flow(far, now, before), atol=1e-3, rtol=0)


def test_push_in_came_from_nearer_the_middle() -> None:
    flow = backward_flow(torch.full((1, 36, 64), 3.0), cameras_at((0, 0, 0.5)), cameras_at((0, 0, 0)))
    assert (flow[0, 0, :, :32] > 0).all()
    assert (flow[0, 0, :, 32:] < 0).all()
    assert (flow[0, 1, :18] > 0).all()


def test_camera_that_stays_sees_no_flow() -> None:
    camera = sample_cameras(1, 2)
    flow = backward_flow(depth_map(0, 2), camera, camera)
    assert flow.nan_to_num(0).abs().max() < 1e-4


def test_undefined_depth_has_no_flow() -> None:
    depth = depth_map(0, 2)
    flow = backward_flow(depth, sample_cameras(1, 2), sample_cameras(2, 2))
    assert torch.equal(flow.isnan().any(1), depth.isnan())


def test_first_frame_has_no_flow_row_13() -> None:
    now = Features(SIZE, depth=depth_map(0, 2), camera=sample_cameras(1, 2))
    flow = SceneFlow()(now, None).flow
    assert flow.shape == (2, 2, 36, 64)
    assert flow.isnan().all()


def test_vectors_are_in_pixels_of_the_features_size() -> None:
    depth, now, before = torch.full((1, 36, 64), 3.0), sample_cameras(1, 1), sample_cameras(2, 1)
    small = SceneFlow()(Features(SIZE, depth=depth, camera=now), Features(SIZE, camera=before)).flow
    large = SceneFlow()(Features((128, 72), depth=depth, camera=now), Features((128, 72), camera=before)).flow
    torch.testing.assert_close(large, 2 * small, rtol=1e-4, atol=1e-4)


def test_cameras_that_ask_for_a_gradient_give_the_same_flow_without() -> None:
    now, before, depth = sample_cameras(1, 3), sample_cameras(2, 3), depth_map(3, 3)
    asked = Camera(now.w2c.clone().requires_grad_(), now.K.clone().requires_grad_(), now.size)
    flow = backward_flow(depth, asked, before)
    assert not flow.requires_grad
    torch.testing.assert_close(flow, backward_flow(depth, now, before), rtol=0, atol=0, equal_nan=True)
