"""Overlays: the body's axes are those the angles were made of, flow's colours tell directions apart."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from cltransfer.features import Features
from cltransfer.orientation import orientation_from_axes
from cltransfer.report.overlays import AXES, GIZMO, LEFT, UNSURE, body_axes, draw_flow, draw_reading
from cltransfer.skeleton import JOINTS
from cltransfer.testing import sample_features, without_person

TOWARD = torch.tensor([0.0, 0.0, -1.0])


@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0), (0.7, 0.3, 0.2), (-2.5, -0.4, -0.5), (1.6, 1.0, 0.0)])
def test_the_gizmo_shows_the_axes_that_have_these_angles(angles: tuple[float, float, float]) -> None:
    left, up, front = body_axes(*angles)
    torch.testing.assert_close(torch.linalg.cross(left, up), front, atol=1e-6, rtol=0)
    torch.testing.assert_close(orientation_from_axes(left, up, TOWARD), torch.tensor(angles), atol=1e-5, rtol=0)


def test_four_directions_have_four_colours_and_none_is_white() -> None:
    colours = set()
    for x, y in ((5, 0), (0, 5), (-5, 0), (0, -5)):
        flow = torch.tensor([x, y]).float()[:, None, None].expand(1, 2, 40, 60)
        colours.add(tuple(draw_flow(Features((60, 40), flow=flow), 5.0)[2, 30].tolist()))
    still = draw_flow(Features((60, 40), flow=torch.zeros(1, 2, 40, 60)), 5.0)[2, 30]
    assert len(colours) == 4
    assert still.tolist() == [255, 255, 255]
    unknown = draw_flow(Features((60, 40), flow=torch.full((1, 2, 40, 60), float("nan"))), 5.0)[2, 30]
    assert unknown.tolist() == [128, 128, 128]


@pytest.mark.parametrize("size", [(24, 13), (16, 9), (3, 3)])
def test_of_small_pictures_the_wheel_is_as_large_as_fits(size: tuple[int, int]) -> None:
    flow = torch.zeros(1, 2, size[1], size[0])
    assert draw_flow(Features(size, flow=flow), 5.0).shape == (size[1], size[0], 3)


def test_layers_of_fewer_pixels_than_the_frame_are_drawn() -> None:
    features = sample_features(0, 1)
    frame, layers = (features.image[0] * 255).byte(), features.layers
    few = replace(features, layers=layers[:, :, ::2, ::2])
    spread = replace(features, layers=few.layers.repeat_interleave(2, -1).repeat_interleave(2, -2))
    np.testing.assert_array_equal(draw_reading(frame, few), draw_reading(frame, spread))


def test_a_person_is_drawn_and_nobody_leaves_the_background_alone() -> None:
    features = sample_features(0, 1)
    frame = (features.image[0] * 255).byte()
    assert (draw_reading(frame, features) != frame.permute(1, 2, 0).numpy()).any(-1).mean() > 0.1
    nobody = replace(without_person(features), layers=None)
    np.testing.assert_array_equal(draw_reading(frame, nobody), frame.permute(1, 2, 0).numpy())


BLACK = torch.zeros(3, 200, 200, dtype=torch.uint8)


def forearm(wrist: float, confidence: float) -> np.ndarray:
    """A left elbow that is seen at 50, 100, and the wrist at ``wrist``, 100, over black."""
    keypoints = torch.full((1, 14, 3), float("nan"), dtype=torch.float64)
    keypoints[0, JOINTS.index("left_elbow")] = torch.tensor([50.0, 100.0, 0.9])
    keypoints[0, JOINTS.index("left_wrist")] = torch.tensor([wrist, 100.0, confidence])
    return draw_reading(BLACK, Features((200, 200), keypoints=keypoints))


@pytest.mark.parametrize(("confidence", "colour"), [(0.9, LEFT), (0.0, UNSURE)])
def test_a_bone_is_as_sure_as_the_less_sure_of_its_joints(confidence: float, colour: tuple[int, int, int]) -> None:
    np.testing.assert_allclose(forearm(150.0, confidence)[100, 100], colour, atol=20)  # a thin line is blended


def test_a_joint_farther_off_than_can_be_drawn_is_left_out() -> None:
    np.testing.assert_array_equal(forearm(1e12, 0.9), forearm(float("nan"), 0.9))


@pytest.mark.parametrize("pixel", [10, 11])
def test_a_joint_in_the_middle_of_a_pixel_is_drawn_around_it(pixel: int) -> None:
    keypoints = torch.full((1, 14, 3), float("nan"))
    keypoints[0, 0] = torch.tensor([pixel + 0.5, pixel + 0.5, 0.9])
    drawn = draw_reading(BLACK, Features((200, 200), keypoints=keypoints)).any(-1)
    rows, columns = np.nonzero(drawn)
    assert (rows.min() + rows.max()) / 2 == (columns.min() + columns.max()) / 2 == pixel


def test_a_box_is_drawn_on_the_pixels_at_its_edges() -> None:
    box = torch.tensor([[10.0, 20.0, 30.0, 40.0, 0.9]])
    rows, columns = np.nonzero(draw_reading(BLACK, Features((200, 200), box=box)).any(-1))
    assert (columns.min(), rows.min(), columns.max(), rows.max()) == (10, 20, 39, 59)


@pytest.mark.parametrize(("yaw", "over"), [(0.0, True), (3.0, False)])
def test_an_axis_of_the_body_that_points_at_the_camera_is_drawn_over_the_others(yaw: float, over: bool) -> None:
    drawn = draw_reading(BLACK, Features((200, 200), orientation=torch.tensor([[yaw, 0.0, 0.0]])))
    middle = round(200 - 1.4 * GIZMO * 200)
    assert (tuple(drawn[middle, middle].tolist()) == AXES[2]) == over
