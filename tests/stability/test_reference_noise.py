"""A reference that is read wrongly: shaken joints, an orientation that flips front to back."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
import torch

from cltransfer.features import Features


def shaken(share: float, seed: int) -> Callable[[Features], Features]:
    """Joints moved by a normal error of ``share`` of the frame width."""

    def change(features: Features) -> Features:
        generator = torch.Generator().manual_seed(seed)
        joints = features.require("keypoints").clone()
        noise = torch.randn(joints[..., :2].shape, generator=generator, dtype=joints.dtype)
        joints[..., :2] += share * features.size[0] * noise
        return replace(features, keypoints=joints)

    return change


def turned_round(frames: list[int]) -> Callable[[Features], Features]:
    """An orientation estimator that takes the back for the front in ``frames``."""

    def change(features: Features) -> Features:
        orientation = features.require("orientation").clone()
        orientation[frames, 0] = torch.remainder(orientation[frames, 0] + 2 * math.pi, 2 * math.pi) - math.pi
        return replace(features, orientation=orientation)

    return change


@pytest.mark.parametrize(("share", "position", "rotation"), [(0.01, 0.5, 4.0), (0.03, 1.5, 12.0)])
def test_noise_on_joints_moves_the_camera_a_little(
    filmed: Callable[..., Any],
    solve: Callable[..., Any],
    edited: Callable[..., str],
    errors_of: Callable[..., Any],
    sound: Callable[..., None],
    share: float,
    position: float,
    rotation: float,
) -> None:
    reference, truth = filmed("dolly_zoom")
    found = solve(edited(reference, shaken(share, 0)))
    sound(found)
    off = errors_of(found, truth)
    assert off[0] < position  # subject heights
    assert off[1] < rotation  # degrees


@pytest.mark.parametrize("frames", [[0], [2], [3, 4]], ids=["first", "middle", "end"])
def test_a_minority_of_flipped_frames_does_not_move_the_camera_behind_the_person(
    filmed: Callable[..., Any],
    solve: Callable[..., Any],
    edited: Callable[..., str],
    errors_of: Callable[..., Any],
    sound: Callable[..., None],
    frames: list[int],
) -> None:
    reference, truth = filmed("push_in")
    found = solve(edited(reference, turned_round(frames)))
    sound(found)
    _, rotation, _ = errors_of(found, truth)
    assert rotation < 2  # degrees


def test_flips_that_the_shoulders_contradict_change_nothing(
    filmed: Callable[..., Any], solve: Callable[..., Any], edited: Callable[..., str]
) -> None:
    reference, _ = filmed("push_in")
    right, flipped = (solve(edited(reference, turned_round(frames))) for frames in ([], [0, 2, 4]))
    torch.testing.assert_close(flipped.trajectory.camera.w2c, right.trajectory.camera.w2c, atol=1e-6, rtol=0)
    assert flipped.noise == pytest.approx(right.noise)  # a flip is no jitter, and stops no search early
