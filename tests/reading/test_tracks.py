"""Front and back sorted out, jitter filtered, nothing moved that was right."""

from __future__ import annotations

import math

import pytest
import torch

from cltransfer.features import Features
from cltransfer.reading.tracks import cleaned, facing, leaps, repair_flips, righted
from cltransfer.skeleton import JOINTS


def wrapped(x: torch.Tensor) -> torch.Tensor:
    return (x + math.pi).remainder(2 * math.pi) - math.pi


@pytest.mark.parametrize("share", [0.0, 0.1, 0.3, 0.4])
def test_flipped_frames_are_turned_back(share: float) -> None:
    generator = torch.Generator().manual_seed(3)
    right = 0.4 + 0.6 * torch.linspace(0, 1, 40, dtype=torch.float64)
    flipped = torch.randperm(40, generator=generator) < 40 * share
    read = wrapped(right + math.pi * flipped)
    error = wrapped(repair_flips(read) - right).abs()
    assert float((error < 1e-6).double().mean()) >= 0.95


def test_a_flipped_first_frame_does_not_lock_the_clip() -> None:
    right = torch.full((10,), 0.3, dtype=torch.float64)
    read = right.clone()
    read[0] += math.pi
    torch.testing.assert_close(repair_flips(read), right)


def test_a_body_that_really_turns_around_is_left_alone() -> None:
    turning = wrapped(torch.linspace(0, 2 * math.pi, 48, dtype=torch.float64))
    torch.testing.assert_close(repair_flips(turning), turning)


def shown(yaw: torch.Tensor, roll: float = 0.0) -> Features:
    """A body of three joints seen from ``yaw`` (N,), leaning by ``roll``."""
    across = torch.tensor([math.cos(roll), math.sin(roll)], dtype=torch.float64)
    up = torch.tensor([math.sin(roll), -math.cos(roll)], dtype=torch.float64)
    joints = torch.zeros(len(yaw), 14, 3, dtype=torch.float64)
    for name, side, height in (("left_shoulder", 12.0, 0.0), ("right_shoulder", -12.0, 0.0), ("head_top", 0.0, 19.0)):
        place = 50 + side * yaw.cos()[:, None] * across + height * up
        joints[:, JOINTS.index(name)] = torch.cat([place, torch.ones(len(yaw), 1)], dim=1)
    orientation = torch.stack([yaw, torch.zeros_like(yaw), torch.full_like(yaw, roll)], dim=1)
    return Features((100, 100), keypoints=joints, orientation=orientation)


@pytest.mark.parametrize("side", [0.4, 2.6])
@pytest.mark.parametrize("roll", [0.0, 0.7])
def test_half_the_frames_flipped_are_sorted_out_by_the_shoulders(side: float, roll: float) -> None:
    right = side + 0.2 * torch.linspace(-1, 1, 20, dtype=torch.float64)
    told = facing(shown(right, roll))
    read = wrapped(right + math.pi * (torch.arange(20) % 2 == 0))
    torch.testing.assert_close(wrapped(repair_flips(read, told) - right), torch.zeros(20, dtype=torch.float64))
    torch.testing.assert_close(wrapped(repair_flips(wrapped(read + math.pi), told) - right), torch.zeros_like(right))


def test_an_orientation_that_is_sure_of_itself_is_not_turned_by_the_shoulders() -> None:
    yaw = torch.full((10,), 0.3, dtype=torch.float64)
    torch.testing.assert_close(repair_flips(yaw, -facing(shown(yaw))), yaw)


def test_shoulders_in_profile_or_unseen_say_nothing() -> None:
    features = shown(torch.tensor([math.pi / 2, 0.0], dtype=torch.float64))
    features.require("keypoints")[1, JOINTS.index("left_shoulder"), 2] = 0.1
    assert facing(features).abs().lt(1e-9).all()
    assert facing(Features((10, 10), orientation=torch.zeros(3, 3))).tolist() == [0, 0, 0]


def test_frames_without_a_person_are_passed_over() -> None:
    yaw = torch.tensor([0.1, math.nan, 0.1 + math.pi, 0.1, math.nan], dtype=torch.float64)
    repaired = repair_flips(yaw)
    assert torch.isnan(repaired).tolist() == [False, True, False, False, True]
    torch.testing.assert_close(repaired[[0, 2, 3]], torch.full((3,), 0.1, dtype=torch.float64))


@pytest.mark.parametrize("apart", [1, 20])
def test_who_turned_while_nobody_saw_it_has_turned(apart: int) -> None:
    """Of neighbours a jump by half a turn is the reader's; over many frames it is the body's."""
    yaw = torch.cat([torch.zeros(12), torch.full((apart - 1,), math.nan), torch.full((3,), 3.1)])
    turned = repair_flips(yaw.double())[-3:].abs()
    assert bool((turned > 3).all() if apart > 1 else (turned < 0.1).all())


def test_joints_are_not_filtered_across_a_change_of_the_visible_set() -> None:
    keypoints = torch.zeros(10, 14, 3)
    keypoints[..., 2] = 1.0
    keypoints[:5, 6:8, 2] = 0.0  # hips come into the frame at frame 5, and all joints jump
    keypoints[5:, :, 0] = 50.0
    keypoints[..., 0] += 10
    got = cleaned(Features((100, 100), keypoints=keypoints), 2.0).require("keypoints")
    torch.testing.assert_close(got, keypoints)


def test_angles_are_not_filtered_across_frames_without_a_person() -> None:
    yaw = torch.zeros(60, 3)
    yaw[20:40] = math.nan
    yaw[40:, 0] = 1.2  # who comes back stands elsewhere
    got = cleaned(Features((10, 10), orientation=yaw), 1.0).require("orientation")
    torch.testing.assert_close(got, yaw, equal_nan=True)


def test_a_steady_motion_stays_one_however_its_frames_are_spaced() -> None:
    at = torch.tensor([0.0, 1, 3, 4, 6, 7, 9, 10, 12, 13], dtype=torch.float64)
    keypoints = torch.ones(10, 14, 3)
    keypoints[..., 0] = 5 + 4 * at[:, None]
    features = Features((100, 100), keypoints=keypoints, orientation=0.05 * at[:, None].float().expand(10, 3))
    got = cleaned(features, 1.0, at)
    torch.testing.assert_close(got.require("keypoints"), keypoints)
    by_number = cleaned(features, 1.0).require("keypoints")
    assert float((by_number - keypoints).abs().max()) > 0.5  # px of steps of 4 and 8


def test_zero_leaves_what_was_read() -> None:
    features = Features((10, 10), orientation=torch.rand(6, 3))
    assert cleaned(features, 0.0) is features


def test_who_turns_round_between_frames_that_are_far_apart_is_believed() -> None:
    """Both readers say so; within a twenty-fourth of a second nobody does."""
    yaw = torch.deg2rad(torch.tensor([0.0, 0, 175, 175, 175, 175], dtype=torch.float64))
    front, seconds = torch.tensor([1.0, 1, -1, -1, -1, -1]), torch.arange(6).double()
    torch.testing.assert_close(repair_flips(yaw, front, 2 * seconds), yaw)
    quick = repair_flips(yaw, front, seconds / 24)
    assert float(wrapped(quick[:2] - math.pi).abs().max()) < 0.01


def test_a_yaw_that_goes_round_the_back_is_filtered_along_the_way_it_goes() -> None:
    yaw = torch.linspace(2.9, 3.4, 24, dtype=torch.float64)
    angles = torch.stack([wrapped(yaw), 0 * yaw, 0 * yaw], dim=1)
    got = cleaned(Features((10, 10), orientation=angles), 2.0).require("orientation")
    assert float(wrapped(got[:, 0] - yaw).abs().max()) < 0.03
    assert float(got[:, 0].abs().max()) <= math.pi


def test_one_angle_that_is_read_elsewhere_is_left_out() -> None:
    angles = torch.zeros(24, 3, dtype=torch.float64)
    angles[12] = 0.5
    got = cleaned(Features((10, 10), orientation=angles), 1.0).require("orientation")
    assert float(got.abs().max()) < 0.02


def degrees(*pitch: float, column: int = 1) -> Features:
    """Frames in which one angle is ``pitch`` [degrees], NaN where nobody is read, and the others stand."""
    angles = torch.zeros(len(pitch), 3, dtype=torch.float64)
    angles[:, column] = torch.deg2rad(torch.tensor(pitch, dtype=torch.float64))
    angles[torch.isnan(angles[:, column])] = math.nan
    return Features((10, 10), orientation=angles)


@pytest.mark.parametrize("column", [0, 1, 2])
def test_a_first_and_a_last_angle_that_are_read_elsewhere_are_left_out(column: int) -> None:
    read = degrees(67, 12, 12, 11, 11, 10, 10, 55, column=column)
    assert list(leaps(read)) == [0, 7]
    got = cleaned(read, 1.0).require("orientation").rad2deg()
    assert float((got[:, column] - torch.linspace(12.5, 9.5, 8)).abs().max()) < 1


def test_an_end_that_is_read_elsewhere_is_led_to_by_a_line_however_frames_are_spaced() -> None:
    at = torch.tensor([0.0, 1, 3, 4, 6, 7, 9, 10], dtype=torch.float64)
    line = 170 + 8 * at
    read = line.clone()
    read[0], read[-1] = line[0] + 90, line[-1] - 80
    got = cleaned(degrees(*read.tolist(), column=0), 1.0, at, at / 24).require("orientation")[:, 0]
    torch.testing.assert_close(wrapped(got - line.deg2rad()), torch.zeros(8, dtype=torch.float64))


def test_next_to_frames_without_a_person_an_angle_that_is_read_elsewhere_is_left_out_too() -> None:
    nobody = math.nan
    read = degrees(nobody, 60, 10, 10, 10, nobody, 50, nobody, 10, 10, 50)
    assert list(leaps(read)) == [1]  # what is told by fewer than three stays
    got = cleaned(read, 1.0).require("orientation").rad2deg()
    torch.testing.assert_close(got[1:5, 1], torch.full((4,), 10.0, dtype=torch.float64))
    torch.testing.assert_close(got[6:8], read.require("orientation")[6:8].rad2deg(), equal_nan=True)


@pytest.mark.parametrize(
    "read",
    [
        (0, 40, 80, 120, 160, 200, 240, 280),  # a fast move that begins and ends with the clip
        (0, 0, 0, 0, 10, 30, 60, 100),  # and one that is under way at its end,
        (90, 60, 35, 15, 3, 0, 0, 0),  # or at its beginning
        (20, 4, 3, 5, 6, 8, 11, 16),  # who walks up to the camera, as it was read
        (3, 9, 17, 8, 4, 17, 45),  # noise, as of hands before the body
        (60, 0, 0),
        (60, 0),
    ],
)
def test_a_true_move_at_an_end_is_no_leap(read: tuple[float, ...]) -> None:
    for column in range(3):
        assert leaps(degrees(*read, column=column)) == leaps(degrees(*reversed(read), column=column)) == {}


@pytest.mark.parametrize("shrunk", [True, False])
def test_joints_of_an_end_that_is_read_elsewhere_are_led_to_where_they_are_elsewhere_too(shrunk: bool) -> None:
    pitch = torch.zeros(8, 3, dtype=torch.float64)
    pitch[0, 1] = 1.0
    joints = torch.rand(14, 2, generator=torch.Generator().manual_seed(0), dtype=torch.float64) * 60 + 20
    moving = joints + torch.arange(8, dtype=torch.float64)[:, None, None]
    read = torch.cat([moving, torch.full((8, 14, 1), 0.9, dtype=torch.float64)], dim=2)
    if shrunk:
        read[0, :, :2] = 50 + (moving[0] - 50) / 3
    else:
        read[0, :, :2] += 1.0
    found = righted(Features((100, 100), orientation=pitch, keypoints=read)).require("keypoints")
    torch.testing.assert_close(found[1:], read[1:])
    torch.testing.assert_close(found[0, :, :2], moving[0] if shrunk else moving[0] + 1.0)


def test_who_has_a_second_to_turn_before_the_next_frame_does_not_leap() -> None:
    read, frames = degrees(67, 12, 12, 11, 11, 10), torch.arange(6).double()
    assert list(leaps(read, times=0.8 * frames)) == [0]
    assert leaps(read, times=1.2 * frames) == {}


def test_shoulders_half_as_far_apart_as_the_head_is_high_are_sure_and_narrower_ones_in_proportion() -> None:
    apart = torch.tensor([1.0, 0.6, 0.5, 0.25, 0.1, -0.1, -0.25, -0.5, -1], dtype=torch.float64)
    told = facing(shown((apart * 19 / 24).acos()))  # they are 24 apart where the body faces the camera, the head 19
    torch.testing.assert_close(told, (2 * apart).clamp(-1, 1))


def test_which_side_faces_the_camera_is_told_alike_of_a_body_that_leans() -> None:
    yaw = torch.tensor([0.2, 1.2, 1.5, 2.0, 3.0], dtype=torch.float64)
    upright = facing(shown(yaw))
    assert 0 < float(upright[2]) < 1  # how surely is told too
    for roll in (0.7, -1.2, 3.0):
        torch.testing.assert_close(facing(shown(yaw, roll)), upright)


@pytest.mark.parametrize("rate", [24.0, 60.0])
def test_who_turns_within_a_step_is_believed_however_short_the_step_is(rate: float) -> None:
    yaw = torch.tensor([0.0] * 5 + [1.8] * 3, dtype=torch.float64)  # the other way round it would be less of a turn
    torch.testing.assert_close(repair_flips(yaw, None, torch.arange(8) / rate), yaw)
    torch.testing.assert_close(repair_flips(yaw), yaw)


@pytest.mark.parametrize("frames", [3, 4])
def test_a_clip_of_few_frames_is_cleaned_too(frames: int) -> None:
    angles = torch.zeros(frames, 3, dtype=torch.float64)
    angles[1, 0] = 3.1
    got = cleaned(Features((10, 10), orientation=angles), 1.0).require("orientation")
    assert float(got.abs().max()) < 0.1


def test_who_had_a_second_to_turn_since_the_frame_before_does_not_leap_either() -> None:
    read, frames = degrees(10, 11, 11, 12, 12, 67), torch.arange(6).double()
    assert list(leaps(read, times=0.8 * frames)) == [5]
    assert leaps(read, times=1.2 * frames) == {}


def test_the_farther_the_next_frames_are_the_more_may_have_happened_since() -> None:
    at = torch.tensor([0.0, 3, 4, 5, 6, 7], dtype=torch.float64)
    assert leaps(degrees(33, 0, 6, 12, 18, 24), at) == {}  # 51 degrees off the line, which turns by 18 up to there
    assert list(leaps(degrees(50, 0, 6, 12, 18, 24), at)) == [0]


def first_elsewhere(size: tuple[int, int], speed: float, off: float) -> Features:
    """Joints that move by ``speed`` [px] a frame; of the first one the angle is another, and they are ``off`` [px]."""
    pitch = torch.zeros(8, 3, dtype=torch.float64)
    pitch[0, 1] = 1.0
    joints = torch.rand(14, 2, generator=torch.Generator().manual_seed(0), dtype=torch.float64) * 60 + 20
    read = joints + speed * torch.arange(8, dtype=torch.float64)[:, None, None]
    read[0] += off
    read = torch.cat([read, torch.full((8, 14, 1), 0.9, dtype=torch.float64)], dim=2)
    return Features(size, orientation=pitch, keypoints=read)


@pytest.mark.parametrize(
    ("size", "speed", "led"), [((100, 100), 0.0, True), ((100, 300), 0.0, False), ((100, 100), 4.0, False)]
)
def test_whether_joints_are_elsewhere_is_told_by_the_longer_side_and_by_how_they_move(
    size: tuple[int, int], speed: float, led: bool
) -> None:
    read = first_elsewhere(size, speed, 5.0)
    assert torch.equal(righted(read).require("keypoints"), read.require("keypoints")) != led


def test_joints_that_are_led_to_are_seen_as_the_next_ones_are_and_one_that_was_not_found_is_no_hindrance() -> None:
    read = first_elsewhere((100, 100), 0.0, 30.0)
    joints = read.require("keypoints")
    joints[0, :, 2] = 0.1
    joints[0, 3] = torch.nan
    torch.testing.assert_close(righted(read).require("keypoints")[0], joints[1])
