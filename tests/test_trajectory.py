"""A path between its frames."""

from __future__ import annotations

import math

import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.trajectory import Trajectory

UP = torch.tensor([0.0, 0, 1], dtype=torch.float64)


def dolly_zoom_around(times: torch.Tensor) -> Trajectory:
    """An orbit that draws nearer while the lens widens: every quantity moves, none in a straight line."""
    turn, distance = 1.5 * times, 3 + torch.cos(times)
    eye = torch.stack([distance * torch.cos(turn), distance * torch.sin(turn), 1 + 0.2 * times], dim=1)
    camera = Camera.look_at(eye, torch.zeros(1, 3, dtype=torch.float64), UP, 0.7, (64, 36))
    K = camera.K.clone()
    K[:, [0, 1], [0, 1]] = (20 * distance)[:, None]
    return Trajectory(Camera(camera.w2c, K, camera.size), times)


def moments(count: int) -> torch.Tensor:
    return torch.linspace(0, 2, count, dtype=torch.float64)


def test_at_its_own_times_a_path_is_itself() -> None:
    path = dolly_zoom_around(moments(7))
    again = path.at(path.times)
    torch.testing.assert_close(again.camera.w2c, path.camera.w2c)
    torch.testing.assert_close(again.camera.K, path.camera.K)


def test_between_its_frames_a_path_goes_on_smoothly() -> None:
    errors = {}
    for count in (9, 17):
        found, true = dolly_zoom_around(moments(count)).at(moments(61)), dolly_zoom_around(moments(61))
        inner = slice(15, 46)  # a natural spline is straight at its ends
        errors[count] = [
            float((found.camera.center - true.camera.center)[inner].norm(dim=1).max()),
            float((found.camera.w2c - true.camera.w2c)[inner, :3, :3].abs().max()),
            float((found.camera.focal / true.camera.focal).log()[inner].abs().max()),
        ]
    assert max(errors[9]) < 0.01  # heights, and parts; the frames are 0.37 rad of orbit apart
    assert all(fine < coarse / 6 for fine, coarse in zip(errors[17], errors[9]))


def test_between_two_frames_a_path_is_straight() -> None:
    path = dolly_zoom_around(torch.tensor([0.0, 1.0], dtype=torch.float64))
    middle = path.at(torch.tensor([0.5], dtype=torch.float64)).camera
    torch.testing.assert_close(middle.center[0], path.camera.center.mean(0))
    torch.testing.assert_close(middle.focal[0], path.camera.focal.log().mean().exp())
    R = middle.w2c[0, :3, :3]
    torch.testing.assert_close(R @ R.T, torch.eye(3, dtype=torch.float64))
    angle = (torch.einsum("nii->n", path.camera.w2c[:, :3, :3] @ R.T) - 1).div(2).clamp(-1, 1).acos()
    assert float(angle[0]) == pytest.approx(float(angle[1]))
    assert 0 < float(angle[0]) < math.pi / 2


def test_a_frame_alone_stands() -> None:
    path = dolly_zoom_around(moments(1))
    assert len(path.at(path.times)) == 1


def test_outside_its_times_there_is_no_path() -> None:
    with pytest.raises(ValueError, match=r"times must be within 0 to 2 s, got -0\.1 to 1"):
        dolly_zoom_around(moments(3)).at(torch.tensor([-0.1, 1.0], dtype=torch.float64))
