"""Correction: what the networks see differs from what the geometry says, by a bias that the next search can aim off.

After solving on geometry the networks read the rendered frames; network minus geometry is the networks' bias there.
It is noisier than the tolerances, so it is taken robustly: gated by visibility and size, a median and a smooth line
along the clip per joint and per angle, unless the config asks for each frame's own (``extract.bias=frame``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from ..along_clip import along, counted, running_median
from ..features import Features
from ..orientation import wrap
from ..skeleton import VISIBLE

FARTHEST = 0.08  # [frame] a joint further off than this was read wrong, not biased
WIDEST = 0.8  # [rad] the same for an angle
LEAST = 5  # frames that must agree before a bias is believed


@dataclass(frozen=True)
class Bias:
    """Network minus geometry along a clip of N frames.

    Args:
        joints: (N, 14, 2) [frame]; 0 where nothing is known, and throughout where joints are not read.
        angles: yaw, pitch, roll, (N, 3) [rad]; 0 where nothing is known.
    """

    joints: Tensor  # (N, 14, 2)
    angles: Tensor  # (N, 3)

    @property
    def known(self) -> bool:
        """Whether there is anything to aim off."""
        return bool(self.joints.any() or self.angles.any())


def measure_bias(network: Features, geometry: Features, window: float, at: Tensor | None = None) -> Bias:
    """The bias of ``network`` against ``geometry``, two readings of the same N frames.

    Args:
        network: read by image extractors.
        geometry: read by scene extractors.
        window: standard deviation of the smoothing along the clip [frames]; 0 takes every frame's own difference.
        at: places of the frames, see :func:`cltransfer.along_clip.places`; None are evenly spaced.
    """
    at = counted(len(geometry), at)
    joints = torch.zeros(len(geometry), 28, dtype=torch.float64)
    if network.has("keypoints") and geometry.has("keypoints"):
        off = _joints(network) - _joints(geometry)
        sure = (network.require("keypoints")[..., 2] > VISIBLE) & (off.norm(dim=-1) < FARTHEST)
        joints = _smooth(off.flatten(1), sure.repeat_interleave(2, dim=1), window, at)
    angles = torch.zeros(len(geometry), 3, dtype=torch.float64)
    if network.has("orientation") and geometry.has("orientation"):
        turn = wrap(network.require("orientation").double() - geometry.require("orientation").double())
        angles = _smooth(turn, turn.abs() < WIDEST, window, at)
    return Bias(joints.unflatten(1, (14, 2)), angles)


def corrected(wanted: Features, bias: Bias) -> Features:
    """The target ``wanted`` (N frames) with the bias taken off, so that the networks will read what was wanted."""
    size = torch.tensor(wanted.size, dtype=torch.float64)
    new: dict[str, Any] = {}
    if wanted.has("keypoints"):
        keypoints = wanted.require("keypoints").double().clone()
        keypoints[..., :2] -= bias.joints * size
        new["keypoints"] = keypoints
    if wanted.has("orientation"):
        new["orientation"] = wrap(wanted.require("orientation").double() - bias.angles)
    return replace(wanted, **new)


def _joints(features: Features) -> Tensor:
    return features.require("keypoints")[..., :2].double() / torch.tensor(features.size, dtype=torch.float64)


def _smooth(off: Tensor, sure: Tensor, window: float, at: Tensor) -> Tensor:
    """Bias (N, D) of frames that stand ``at`` (N,), 0 in columns with too few sure frames."""
    known = torch.where(sure & torch.isfinite(off), off, math.nan)
    if window == 0:
        return torch.nan_to_num(known)
    bias = torch.zeros_like(off)
    for d in range(off.shape[1]):
        index = torch.isfinite(known[:, d]).nonzero()[:, 0]
        if len(index) < LEAST:
            continue
        values = running_median(known[index, d : d + 1])
        placed = torch.full((len(off), 1), math.nan, dtype=off.dtype)
        placed[index] = values
        bias[:, d] = _filled(along(placed, window, at)[:, 0], at)
    return bias


def _filled(line: Tensor, at: Tensor) -> Tensor:
    """A line (N,) ``at`` (N,) with NaN replaced by the nearest known value."""
    index = torch.isfinite(line).nonzero()[:, 0]
    nearest = (at[:, None] - at[index][None]).abs().argmin(1)
    return line[index[nearest]]
