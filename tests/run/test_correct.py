"""The networks' bias: measured robustly, aimed off, and not invented where little is known."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from cltransfer.along_clip import places
from cltransfer.features import Features
from cltransfer.run.correct import corrected, measure_bias

N = 24


def clip(size: tuple[int, int], joints: Tensor, angles: Tensor, confidence: float = 1.0) -> Features:
    """Features of joints (N, 14, 2) [frame] and angles (N, 3)."""
    pixels = joints * torch.tensor(size, dtype=torch.float64)
    keypoints = torch.cat([pixels, torch.full((len(pixels), 14, 1), confidence, dtype=torch.float64)], dim=2)
    return Features(size, keypoints=keypoints, orientation=angles)


def scene() -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(0)
    joints = 0.3 + 0.4 * torch.rand(1, 14, 2, generator=generator, dtype=torch.float64).expand(N, -1, -1)
    drift = torch.linspace(0, 0.1, N, dtype=torch.float64)
    return joints + drift[:, None, None], drift[:, None].expand(-1, 3)


def test_a_steady_bias_is_found_whatever_the_sizes_of_the_frames() -> None:
    joints, angles = scene()
    network = clip((480, 908), joints + 0.02, angles + 0.2)
    bias = measure_bias(network, clip((85, 160), joints, angles), 4.0)
    torch.testing.assert_close(bias.joints, torch.full((N, 14, 2), 0.02, dtype=torch.float64))
    torch.testing.assert_close(bias.angles, torch.full((N, 3), 0.2, dtype=torch.float64))


def test_outliers_and_noise_hardly_move_it() -> None:
    joints, angles = scene()
    generator = torch.Generator().manual_seed(1)
    noise = 0.005 * torch.randn(N, 14, 2, generator=generator, dtype=torch.float64)
    read = joints + 0.02 + noise
    read[::5, 3] += 0.3  # a joint that is read elsewhere in every fifth frame
    turned = angles + 0.2
    turned[3, 0] += math.pi  # a flip
    bias = measure_bias(clip((480, 908), read, turned), clip((85, 160), joints, angles), 4.0)
    error = (bias.joints - 0.02).abs()
    assert float(error.mean()) < 0.002  # noise of 0.005, outliers of 0.3
    assert float(error.max()) < 0.015
    torch.testing.assert_close(bias.angles, torch.full((N, 3), 0.2, dtype=torch.float64))


def test_where_no_joints_are_read_only_angles_are_corrected() -> None:
    joints, angles = scene()
    whole = clip((480, 908), joints + 0.02, angles + 0.2)
    bias = measure_bias(replace(whole, keypoints=None), replace(clip((85, 160), joints, angles), keypoints=None), 4.0)
    assert float(bias.joints.abs().max()) == 0
    aimed = corrected(replace(whole, keypoints=None), bias)
    assert aimed.keypoints is None
    torch.testing.assert_close(aimed.require("orientation"), angles.contiguous())


def test_what_is_not_seen_is_not_corrected() -> None:
    joints, angles = scene()
    unsure = clip((480, 908), joints + 0.02, angles, confidence=0.3)
    assert float(measure_bias(unsure, clip((85, 160), joints, angles), 4.0).joints.abs().max()) == 0


@pytest.mark.parametrize(("frames", "known"), [(4, False), (5, True)])
def test_too_few_frames_tell_no_bias(frames: int, known: bool) -> None:
    joints, angles = (value[:frames] for value in scene())
    bias = measure_bias(clip((480, 908), joints + 0.01, angles), clip((85, 160), joints, angles), 4.0)
    assert bias.known == known
    assert measure_bias(clip((480, 908), joints + 0.01, angles), clip((85, 160), joints, angles), 0.0).known


def test_aiming_off_the_bias_makes_the_networks_read_what_was_wanted() -> None:
    joints, angles = scene()
    wanted = clip((480, 908), joints, angles)
    network = clip((480, 908), joints + 0.02, angles + 0.2)  # read on a result that geometry calls perfect
    target = corrected(wanted, measure_bias(network, clip((85, 160), joints, angles), 4.0))
    size = torch.tensor([480, 908], dtype=torch.float64)
    torch.testing.assert_close(target.require("keypoints")[..., :2] / size + 0.02, joints)
    torch.testing.assert_close(target.require("orientation") + 0.2, angles)
    assert torch.equal(target.require("keypoints")[..., 2], wanted.require("keypoints")[..., 2])


@pytest.mark.parametrize("lost", [0, 10, 23])
def test_frames_without_a_person_take_the_bias_of_their_neighbours(lost: int) -> None:
    joints, angles = scene()
    read = joints + 0.02
    read[lost] = math.nan
    bias = measure_bias(clip((480, 908), read, angles), clip((85, 160), joints, angles), 4.0)
    torch.testing.assert_close(bias.joints[lost], torch.full((14, 2), 0.02, dtype=torch.float64))


def test_a_bias_that_changes_steadily_is_found_however_the_frames_are_spaced() -> None:
    joints, angles = scene()
    times = torch.arange(N, dtype=torch.float64) / 24 + (torch.arange(N) >= 10) * 0.125  # three frames were left out
    off = 0.02 + 0.02 * times[:, None, None]
    unsure = torch.arange(N) == 10  # right after those
    network = clip((480, 908), torch.where(unsure[:, None, None], joints + 0.5, joints + off), angles + 0.2)
    bias = measure_bias(network, clip((85, 160), joints, angles), 4.0, places(times))
    there = bias.joints - torch.where(unsure[:, None, None], off[11], off)  # the nearest in time, not the one before
    assert float(there.abs().max()) < 1e-9


def test_a_bias_of_the_yaw_is_small_behind_the_person_too() -> None:
    """There 3.1 and -3.1 are 0.08 apart."""
    joints, angles = scene()
    behind, read = angles.clone(), angles.clone()
    behind[:, 0], read[:, 0] = 3.1, -3.1
    size = (160, 90)
    bias = measure_bias(clip(size, joints, read), clip(size, joints, behind), 4.0)
    torch.testing.assert_close(bias.angles[:, 0], torch.full((N,), 2 * math.pi - 6.2, dtype=torch.float64))
    aimed = corrected(clip(size, joints, read), bias).require("orientation")[:, 0]
    torch.testing.assert_close(aimed, torch.full((N,), 3.1, dtype=torch.float64))


def test_readings_that_are_off_by_little_do_not_move_the_bias() -> None:
    """Too near to be left out by how far they are off: the median leaves them out."""
    joints, angles = scene()
    read, turned = joints + 0.01, angles + 0.1
    read[2::5] += 0.06
    turned[2::5] += 0.3
    bias = measure_bias(clip((480, 908), read, turned), clip((480, 908), joints, angles), 4.0)
    assert float((bias.joints - 0.01).abs().max()) < 0.005
    assert float((bias.angles - 0.1).abs().max()) < 0.02
