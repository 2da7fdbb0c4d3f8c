"""The camera's angle on the person, and how deep the frame is staged, in words."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..features import Features
from ..losses.filmic_space import layer_depths

HEIGHTS = ("low angle", "eye level", "high angle", "overhead")
# Pitch is about the middle of what is shown: a camera as high as the eyes looks down on that by up to 10 degrees, and
# networks read some 10 more of a body that the frame cuts.
HEIGHT_BOUNDS = (math.radians(-8), math.radians(25), math.radians(65))
STEEP = math.radians(82)  # from right above or below nobody has a side, and no camera is canted
DUTCH = math.radians(12)  # of roll: bodies lean by less before a level camera

SIDES = ("front", "three-quarter front", "profile", "three-quarter back", "back")
SIDE_BOUNDS = (math.radians(22.5), math.radians(67.5), math.radians(112.5), math.radians(157.5))

STAGINGS = ("flat", "moderate", "deep")
STAGING_BOUNDS = (math.log(1.3), math.log(2.0))  # of the depths of neighbouring layers
LEAST_LAYER = 0.005  # of the frame


def height_class(orientation: Tensor) -> Tensor:
    """Index (N,) into :data:`HEIGHTS` of yaw, pitch, roll (N, 3) [rad]; -1 where undefined."""
    return _classed(orientation[:, 1], HEIGHT_BOUNDS)


def side_class(orientation: Tensor) -> Tensor:
    """Index (N,) into :data:`SIDES` of yaw, pitch, roll (N, 3) [rad]; -1 where undefined, as from right above."""
    yaw = torch.remainder(orientation[:, 0] + math.pi, 2 * math.pi) - math.pi
    return _classed(yaw.abs(), SIDE_BOUNDS).masked_fill(_steep(orientation), -1)


def dutch_class(orientation: Tensor) -> Tensor:
    """1 where the camera is canted, 0 where it is level, (N,), of yaw, pitch, roll (N, 3) [rad]; -1 where undefined."""
    return _classed(orientation[:, 2].abs(), (DUTCH,)).masked_fill(_steep(orientation), -1)


def _steep(orientation: Tensor) -> Tensor:
    """Where the camera looks down, or up, too steeply for yaw and roll to mean anything, (N,) bool."""
    return orientation[:, 1].abs() > STEEP


def staging_class(features: Features) -> Tensor:
    """Index (N,) into :data:`STAGINGS`, by the widest step between neighbouring layers; -1 where undefined.

    Needs ``depth`` and ``layers``. The representative depths are those of filmic space (paper Eq. 10).
    """
    foreground, character, background = layer_depths(features, LEAST_LAYER).log().unbind(-1)
    behind, before = background - character, character - foreground
    step = torch.where(before.isfinite(), torch.maximum(behind, before), behind)
    return _classed(step, STAGING_BOUNDS)


def _classed(value: Tensor, bounds: tuple[float, ...]) -> Tensor:
    found = torch.bucketize(value.contiguous(), value.new_tensor(bounds), right=True)
    return found.masked_fill(value.isnan(), -1)
