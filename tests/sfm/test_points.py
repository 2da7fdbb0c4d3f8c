"""Tracks and points from corners made by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.sfm.corners import Corners, Match, find_corners, match_clip
from cltransfer.sfm.points import find_points, tracks

UP = torch.tensor([0.0, -1.0, 0.0])


def cameras(count=4):
    eye = torch.tensor([[0.4 * i, 0.0, 0.0] for i in range(count)], dtype=torch.float64)
    return Camera.look_at(eye, eye + torch.tensor([0.0, 0.0, 1.0]), UP, math.radians(40), (640, 360))


def seen(camera, places, hidden):
    """Corners of points that are at ``places`` (N, P, 3) in each of N frames."""
    pixels = camera.project(places)[0]
    mark = np.array(hidden)
    return [Corners(p.numpy(), np.zeros((len(p), 128), np.float32), mark) for p in pixels]


def links(count, points):
    same = np.stack([np.arange(points)] * 2, axis=1)
    return [Match((i, i + 1), same) for i in range(count - 1)]


def test_points_that_stand_still_are_found_and_those_that_move_are_not():
    camera = cameras()
    places = torch.tensor([[0.5, 0.2, 5.0], [0.3, -0.4, 8.0], [0.6, 0.0, 6.0]], dtype=torch.float64).repeat(4, 1, 1)
    places[:, 2, 1] += torch.arange(4) * 0.3  # it rises while the camera moves aside
    found = find_points(camera, seen(camera, places, [False, True, True]), links(4, 3))
    assert sorted(found.frames.tolist()) == [0, 0, 1, 1, 2, 2, 3, 3]
    torch.testing.assert_close(found.depth[~found.hidden], torch.full((4,), 5.0, dtype=torch.float64))
    torch.testing.assert_close(found.depth[found.hidden], torch.full((4,), 8.0, dtype=torch.float64))


def test_a_far_point_is_less_sure_than_a_near_one():
    camera = cameras()
    places = torch.tensor([[0.5, 0.2, 5.0], [0.5, 0.2, 200.0]], dtype=torch.float64).repeat(4, 1, 1)
    found = find_points(camera, seen(camera, places, [False, False]), links(4, 2))
    near, far = (float(found.confidence[(found.depth > 100) == side].mean()) for side in (False, True))
    focal = float(camera.focal[0])
    for depth, confidence in ((5.0, near), (200.0, far)):
        rays = torch.tensor([0.5, 0.2, depth]) - camera.center[[0, 3]].float()
        angle = torch.acos(torch.nn.functional.cosine_similarity(rays[0], rays[1], dim=0).double())
        assert confidence == pytest.approx(0.5 ** ((0.5 / (focal * float(angle)) / 0.1) ** 2), abs=0.02)
    assert far < 0.9 < near


def test_a_point_is_as_sure_as_its_corners_agree_however_many_they_are():
    """The corners are 1.5 px above and below the point, in turns: no other place explains them."""
    for count in (4, 8):
        camera = cameras(count)
        corners = seen(camera, torch.tensor([[0.5, 0.2, 60.0]], dtype=torch.float64).repeat(count, 1, 1), [False])
        for frame, corner in enumerate(corners):
            corner.pixels[:, 1] += 1.5 * (-1) ** frame
        found = find_points(camera, corners, links(count, 1))
        parallax = float(camera.focal[0]) * 0.4 * (count - 1) / 60  # of the farthest views [px]
        assert found.confidence.tolist() == pytest.approx([0.5 ** ((1.5 / parallax / 0.1) ** 2)] * count, abs=0.02)


def test_a_track_that_meets_a_frame_twice_is_dropped():
    corners = [Corners(np.zeros((2, 2)), np.zeros((2, 128)), np.zeros(2, bool)) for _ in range(3)]
    good = [Match((0, 1), np.array([[0, 1]])), Match((1, 2), np.array([[1, 0]]))]
    (only,) = tracks(corners, good)
    assert [column.tolist() for column in only] == [[0, 1, 2], [0, 1, 0]]
    assert tracks(corners, [*good, Match((0, 2), np.array([[1, 0]]))]) == []


def test_nothing_seen_alike_is_no_point():
    camera = cameras(3)
    places = torch.tensor([[0.5, 0.2, 5.0]], dtype=torch.float64).repeat(3, 1, 1)
    assert len(find_points(camera, seen(camera, places, [False]), []).depth) == 0


def test_corners_are_found_again_where_a_picture_was_moved():
    noise = np.random.default_rng(0).integers(0, 255, (60, 80, 3), np.uint8).repeat(4, 0).repeat(4, 1)
    moved = np.roll(noise, (8, 12), axis=(0, 1))
    subject = np.zeros(noise.shape[:2], bool)
    subject[:100, :100] = True
    first, second = find_corners(noise, subject), find_corners(moved, subject)
    (match,) = match_clip([first, second])
    shift = second.pixels[match.index[:, 1]] - first.pixels[match.index[:, 0]]
    np.testing.assert_allclose(np.median(shift, axis=0), [12.0, 8.0], atol=0.05)
    inside = (first.pixels < 100).all(1)
    assert first.hidden[inside].all()
    assert not first.hidden[(first.pixels > 110).any(1)].any()
