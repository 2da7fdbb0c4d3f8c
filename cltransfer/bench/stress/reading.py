"""Stress by how the reference was read: what networks do to joints, depth, flow and angles."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import interpolate

from ...features import Features
from .case import Case, Stressor

JITTER = 0.04  # of the frame's height, standard deviation where every joint is lost
WHIP = 0.1  # of the frame's width: longest vector a wrong flow shows
PATCHES = 8  # along the shorter side of the frame: wrong flow comes in patches


def lost_joints(case: Case, share: float, rng: np.random.Generator) -> Case:
    """``share`` of the joints are not seen, the others are off by as much of :data:`JITTER`."""
    joints = case.reference.require("keypoints").clone()
    count, height = joints.shape[:2], case.reference.size[1]
    joints[..., :2] += torch.from_numpy(rng.normal(0, share * JITTER * height, (*count, 2))).to(joints)
    joints[..., 2][_drawn(rng, share, count)] = 0
    return _read(case, keypoints=joints)


def shifted_depth(case: Case, shift: float, rng: np.random.Generator) -> Case:
    """Inverse depth plus ``shift`` times its median, at a scale of its own in every frame, as networks have it."""
    depth = case.reference.require("depth")
    inverse = 1 / depth
    scale = torch.from_numpy(rng.lognormal(0, 0.2, (len(depth), 1, 1))).to(depth)
    return _read(case, depth=scale / (inverse + shift * inverse.flatten(1).nanmedian(1).values[:, None, None]))


def wild_flow(case: Case, share: float, rng: np.random.Generator) -> Case:
    """``share`` of the frame's patches move anyhow."""
    flow = case.reference.require("flow")
    patch = _patches(flow, share, rng)
    longest = WHIP * case.reference.size[0]
    grid = _grid(flow)
    wild = torch.from_numpy(rng.uniform(-longest, longest, (len(flow), 2, *grid))).to(flow)
    wild = interpolate(wild, tuple(flow.shape[-2:]), mode="nearest-exact")
    return _read(case, flow=torch.where(patch & flow.isfinite(), wild, flow))


def still_flow(case: Case, share: float, rng: np.random.Generator) -> Case:
    """``share`` of the frame's patches have no texture, so that no motion is seen there."""
    flow = case.reference.require("flow")
    return _read(case, flow=torch.where(_patches(flow, share, rng) & flow.isfinite(), torch.zeros_like(flow), flow))


def flipped_yaw(case: Case, share: float, rng: np.random.Generator) -> Case:
    """``share`` of the frames take the person's back for the front."""
    angles = case.reference.require("orientation").clone()
    angles[_drawn(rng, share, (len(angles),)), 0] += math.pi
    return _read(case, orientation=angles)


def _read(case: Case, **features: Tensor) -> Case:
    changed: Features = replace(case.reference, **features)  # type: ignore[arg-type]
    return replace(case, reference=changed)


def _drawn(rng: np.random.Generator, share: float, shape: tuple[int, ...]) -> Tensor:
    """Exactly ``share`` of ``shape``, rounded, bool."""
    count = math.prod(shape)
    chosen = np.zeros(count, bool)
    chosen[rng.permutation(count)[: round(share * count)]] = True
    return torch.from_numpy(chosen).reshape(shape)


def _grid(flow: Tensor) -> tuple[int, int]:
    """Rows and columns of patches."""
    height, width = flow.shape[-2:]
    cell = min(height, width) / PATCHES
    return max(1, round(height / cell)), max(1, round(width / cell))


def _patches(flow: Tensor, share: float, rng: np.random.Generator) -> Tensor:
    """Pixels (N, 1, H, W) of ``share`` of the patches, drawn anew in every frame."""
    drawn = torch.stack([_drawn(rng, share, _grid(flow)) for _ in range(len(flow))])[:, None]
    return interpolate(drawn.float(), tuple(flow.shape[-2:]), mode="nearest-exact") > 0.5


READING = {
    "lost_joints": Stressor("joints unseen, the others off", "of the joints", (0.1, 0.2, 0.35, 0.5, 0.7), lost_joints),
    "shifted_depth": Stressor(
        "inverse depth shifted, scale unsteady", "of its median", (0.1, 0.2, 0.4, 0.8, 1.6), shifted_depth
    ),
    "wild_flow": Stressor("patches of wrong flow", "of the frame", (0.05, 0.1, 0.2, 0.4, 0.6), wild_flow),
    "low_texture": Stressor("patches without any flow", "of the frame", (0.2, 0.4, 0.6, 0.8, 1.0), still_flow),
    "flipped_yaw": Stressor(
        "front and back confused", "of the frames", (0.1, 0.2, 0.3, 0.4, 0.5), flipped_yaw, frames=12
    ),
}
