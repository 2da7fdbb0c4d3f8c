"""What totals cannot tell apart, because networks read the reference."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from cltransfer.config import load_config
from cltransfer.features import Features
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.objective import Objective
from cltransfer.reading.noise import noise_floor, noise_note
from cltransfer.reading.tracks import cleaned
from cltransfer.testing import sample_features

KEPT = ("shot_size", "framing", "camera_angle")  # without movement a frame that shows nobody has no term


def jittery(frames: int) -> Features:
    """One person again and again, read with a jitter of two pixels."""
    clip = Features.concatenate([sample_features(0, 1)] * frames)
    keypoints = clip.require("keypoints").clone()
    keypoints[..., :2] += 2 * torch.randn(keypoints[..., :2].shape, generator=torch.Generator().manual_seed(0))
    return replace(clip, keypoints=keypoints)


def test_frames_that_show_nobody_tell_no_noise() -> None:
    losses = Components.build(load_config()).losses
    objective, clip = Objective({name: losses[name] for name in KEPT}), jittery(12)
    noise = noise_floor(objective, clip, cleaned(clip, 1.0))
    assert noise > 0.01
    blank = replace(
        jittery(24),
        keypoints=torch.cat([clip.require("keypoints"), torch.full((12, 14, 3), torch.nan)]),
        orientation=torch.cat([clip.require("orientation"), torch.full((12, 3), torch.nan)]),
    )
    assert noise_floor(objective, blank, cleaned(blank, 1.0)) == pytest.approx(noise, rel=0.02)
    assert noise_floor(objective, clip, clip) == 0.0
    assert noise_floor(objective, blank[12:], blank[12:]) == 0.0


def test_a_first_angle_that_is_misread_is_an_error_and_no_noise() -> None:
    losses = Components.build(load_config()).losses
    objective, clip = Objective({name: losses[name] for name in KEPT}), jittery(12)
    angles = clip.require("orientation").clone()
    angles[0, 1] += 1.0
    misread = replace(clip, orientation=angles)
    noise = noise_floor(objective, clip, cleaned(clip, 1.0))
    assert noise_floor(objective, misread, cleaned(misread, 1.0)) == pytest.approx(noise, rel=0.02)


def test_a_reader_is_told_of_what_jitters_alone() -> None:
    assert noise_note(0.2587).startswith("up to 0.26 of the total is how the reference")
    assert noise_note(0.0) == noise_note(3e-9) == ""
