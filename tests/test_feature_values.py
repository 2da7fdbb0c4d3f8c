"""Values of another unit are told apart from ours, and what is undefined is none."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from cltransfer.feature_values import odd_values, same_values
from cltransfer.features import Features
from cltransfer.testing import sample_features, without_person

SAMPLE = sample_features(1, 2)
SIZE = torch.tensor([64.0, 36.0])


def having(name: str, columns: slice, factor: torch.Tensor | float) -> Features:
    value = SAMPLE.require(name).clone()
    value[..., columns] *= factor
    return SAMPLE.having(name, value)


@pytest.mark.parametrize(
    ("features", "name", "reason"),
    [
        (having("keypoints", slice(2), 1 / SIZE), "keypoints", "expected pixels of a frame of 64 x 36, got 0."),
        (having("keypoints", slice(2, 3), 100), "keypoints", "expected confidence in [0, 1], got 6"),
        (having("box", slice(4), 1 / SIZE.repeat(2)), "box", "expected pixels of a frame of 64 x 36"),
        (having("orientation", slice(3), 180 / math.pi), "orientation", "expected radians, got a pitch or roll of 26"),
        (having("depth", slice(None), -1), "depth", "expected depths above 0, got -"),
        (
            SAMPLE.having("flow_confidence", torch.full((2, 36, 64), 200.0)),
            "flow_confidence",
            "expected in [0, 1], got 200",
        ),
    ],
)
def test_values_of_another_unit_are_told(features: Features, name: str, reason: str) -> None:
    odd = odd_values(features, features.names())
    assert odd is not None
    assert odd[0] == name
    assert odd[1].startswith(reason)
    assert odd_values(features, features.names() - {name}) is None


def test_what_is_undefined_or_at_an_end_is_not_told() -> None:
    nobody, names = without_person(SAMPLE), SAMPLE.names()
    assert odd_values(SAMPLE, [*names, "gaze"]) is None
    assert odd_values(nobody, names) is None
    lost = SAMPLE.require("depth").clone()
    lost[:, 0], lost[:, 1] = 0.0, torch.nan
    assert odd_values(replace(SAMPLE, depth=lost), names) is None
    whole = having("orientation", slice(3), 0.0).require("orientation") + 2 * math.pi
    assert odd_values(replace(SAMPLE, orientation=whole), names) is None
    corner = replace(SAMPLE, size=(8, 5), keypoints=having("keypoints", slice(2), 1 / SIZE).keypoints)
    assert odd_values(corner, ["keypoints"]) is None


def test_parts_of_a_frame_are_told_of_a_person_that_it_cuts_off() -> None:
    """Trackers guess joints beyond the frame; and write 0 or -1 of those that they did not find."""
    parts = having("keypoints", slice(2), 1 / SIZE).require("keypoints")
    parts[0, 10, 1], parts[1, 4, 0] = 1.02, -0.05
    close = parts.clone()
    close[:, 6:12, 1] += torch.tensor([0.8, 0.8, 2.0, 2.0, 3.0, 3.0])
    for joints in (parts, close):
        odd = odd_values(replace(SAMPLE, keypoints=joints), ["keypoints"])
        assert odd is not None
        assert odd[1].startswith("expected pixels of a frame of 64 x 36, got ")
    pixels = SAMPLE.require("keypoints")
    for lost in (0.0, -1.0):
        joints = torch.full((20, 14, 3), lost)
        joints[..., 2] = 0.0
        assert odd_values(Features(SAMPLE.size, keypoints=joints), ["keypoints"]) is None
        joints[0] = pixels[0]
        assert odd_values(Features(SAMPLE.size, keypoints=joints), ["keypoints"]) is None


def test_an_orbit_of_more_than_a_turn_is_of_radians() -> None:
    orbit = torch.zeros(40, 3)
    orbit[:, 0], orbit[:, 1] = torch.linspace(-math.pi, 4 * math.pi, 40), -0.2
    orbit[3] = torch.nan
    names = ["orientation"]
    assert odd_values(Features((64, 36), orientation=orbit), names) is None
    still, level = torch.tensor([20.0, 4.0, 1.0]), torch.tensor([1.0, 0.0, 0.0])
    degrees = {  # of an orbit, of a camera that stands, and of one that looks down
        "a yaw of 720": torch.rad2deg(orbit) * level,
        "a yaw of 20": still.expand(40, 3),
        "a pitch or roll of 12": torch.tensor([3.0, -12.0, 0.0]).expand(40, 3),
    }
    for came, angles in degrees.items():
        told = f"expected radians, got {came}", "wrap it, or torch.deg2rad if these are degrees"
        assert odd_values(Features((64, 36), orientation=angles), names) == ("orientation", *told)


def test_a_peak_that_goes_beyond_one_is_a_confidence() -> None:
    """As peaks of heatmaps do; logits and percentages go further."""
    peaks = having("keypoints", slice(2, 3), 0.0).require("keypoints")
    peaks[:, :3, 2] = torch.tensor([1.1, 1.9, -0.04])
    names = ["keypoints"]
    assert odd_values(replace(SAMPLE, keypoints=peaks), names) is None
    for beyond in (2.1, -0.5):
        peaks[0, 0, 2] = beyond
        odd = odd_values(replace(SAMPLE, keypoints=peaks), names)
        assert odd is not None
        assert odd[2] == "clip to [0, 1], or divide percentages by 100"


def test_values_are_the_same_with_what_is_undefined_in_the_same_places() -> None:
    some = torch.tensor([[1.0, math.nan]])
    assert same_values(some, some.clone())
    for other in (torch.tensor([[1.0, 2.0]]), torch.tensor([[math.nan, 1.0]]), torch.tensor([1.0, math.nan])):
        assert not same_values(some, other)
        assert not same_values(other, some)
