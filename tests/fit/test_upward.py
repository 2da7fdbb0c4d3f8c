from __future__ import annotations

import math

import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.fit._upward import upward


def around(up: tuple[float, float, float], down: float, turns: torch.Tensor) -> Camera:
    """Cameras at ``turns`` [rad] about the origin that look ``down`` [rad] at it, held level."""
    top = torch.tensor(up, dtype=torch.float64)
    first = torch.linalg.cross(top, top.roll(1))
    first = first / first.norm()
    second = torch.linalg.cross(top, first)
    flat = turns.cos()[:, None] * first + turns.sin()[:, None] * second
    eyes = 3 * (math.cos(down) * flat + math.sin(down) * top)
    return Camera.look_at(eyes, torch.zeros(1, 3), top, 0.8, (64, 48))


RING = torch.arange(8).double() * math.pi / 4
HALF = torch.linspace(-math.pi / 2, math.pi / 2, 9, dtype=torch.float64)


@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)])
@pytest.mark.parametrize("turns", [RING, HALF], ids=["all round", "of one side"])
def test_up_is_the_axis_that_level_cameras_stand_along(up: tuple[float, float, float], turns: torch.Tensor) -> None:
    assert upward(around(up, math.radians(45), turns)) == up
    assert "-0.0" not in str(upward(around(up, 0.3, turns)))


def test_up_that_is_near_no_axis_is_told_as_it_is() -> None:
    up = (0.0, -0.6, -0.8)
    assert upward(around(up, 0.4, RING)) == pytest.approx(up, abs=1e-3)


@pytest.mark.parametrize("degrees", [10.0, 20.0, 29.0])
def test_up_in_the_world_of_a_first_camera_that_looks_down_is_what_the_horizons_tell(degrees: float) -> None:
    """COLMAP's world is the frame of the first image that it places."""
    down = math.radians(degrees)
    turns = torch.arange(16).double() * math.pi / 8
    cameras = around((0.0, 0.0, 1.0), down, turns)
    first = Camera(cameras.w2c @ cameras.w2c[0].inverse(), cameras.K, cameras.size)
    assert upward(first) == pytest.approx((0.0, -math.cos(down), -math.sin(down)), abs=1e-3)


def test_up_is_an_axis_where_cameras_were_held_about_level() -> None:
    cameras, random = around((0.0, 0.0, 1.0), 0.4, RING), torch.Generator().manual_seed(0)
    roll, aslant = torch.eye(4).double().repeat(8, 1, 1), 0.1 * torch.randn(8, generator=random).double()
    roll[:, 0, 0], roll[:, 0, 1], roll[:, 1, 0], roll[:, 1, 1] = (
        aslant.cos(), -aslant.sin(), aslant.sin(), aslant.cos(),
    )  # fmt: skip
    assert upward(Camera(roll @ cameras.w2c, cameras.K, cameras.size)) == (0.0, 0.0, 1.0)


def test_views_that_look_one_way_have_the_mean_of_their_own_up() -> None:
    w2c = torch.eye(4).double().repeat(5, 1, 1)
    w2c[:, 0, 3] = torch.arange(5)
    K = torch.eye(3).double().repeat(5, 1, 1)
    assert upward(Camera(w2c, K, (4, 4))) == (0.0, -1.0, 0.0)


def test_cameras_that_are_held_every_way_tell_no_up() -> None:
    roll = torch.eye(4).double().repeat(4, 1, 1)
    turn = torch.arange(4) * math.pi / 2
    roll[:, 0, 0], roll[:, 0, 1], roll[:, 1, 0], roll[:, 1, 1] = turn.cos(), -turn.sin(), turn.sin(), turn.cos()
    assert upward(Camera(roll, torch.eye(3).double().repeat(4, 1, 1), (4, 4))) is None
