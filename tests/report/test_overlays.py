"""Overlays: the body's axes are those the angles were made of, flow's colours tell directions apart."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from cltransfer.features import Features
from cltransfer.orientation import orientation_from_axes
from cltransfer.report.overlays import body_axes, draw_flow, draw_reading
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
