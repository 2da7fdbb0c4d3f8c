"""Pose matching as in JAWS: heat maps of all joints laid over each other; a baseline for shot size and framing.

JAWS takes the maps of a pose network. Here each joint's map is a Gaussian as such networks are trained on, as high as
the joint's confidence. Its cumulative sum along a row is then a product of a function of x and one of y, so every
comparison of two maps is three inner products and no map is drawn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from ..features import Features, check_pair
from ..registry import LOSSES

HEIGHT = 224  # [px] of the maps; their width follows the frame's shape
SPREAD = 4.0  # [px], standard deviation: 2 of the maps a network learns, widened by 5 x 5 max pooling
TURNS = (0.0, math.pi / 4, math.pi / 2, 3 * math.pi / 4)  # [rad] the maps are turned by
TEMPERATURE = 200.0  # of the softmax over a map
OWN, PAIRS = 0.7, 0.3  # shares of the two parts of the loss
DRAWN = 4  # frames whose maps are drawn at once, 14 MB each


Profiles = tuple[Tensor, Tensor]  # of heat maps, along x and along y


def profiles(joints: Tensor, size: tuple[int, int]) -> Profiles:
    """What heat maps are made of, along x and along y, for all turns of the frame about its middle.

    Args:
        joints: x, y [px of ``size``], height of the map in [0, 1], (B, J, 3); a joint that is NaN has no map.
        size: (W, H) of the maps [px].

    Returns:
        Cumulative sums along x, (B, T, J, W), and profiles along y, (B, T, J, H), float64. Their product is the
        cumulative sum of the map, their heights included.
    """
    width, height = size
    middle = joints.new_tensor([width / 2, height / 2])
    known = torch.isfinite(joints).all(-1)  # (B, J)
    amount = torch.where(known, joints[..., 2], 0.0)[:, None, :, None]
    turns = torch.stack([torch.tensor([[math.cos(a), math.sin(a)], [-math.sin(a), math.cos(a)]]) for a in TURNS])
    offset = torch.where(known[..., None], joints[..., :2], 0.0) - middle
    places = torch.einsum("tij,bkj->btki", turns.to(joints), offset) + middle  # (B, T, J, 2)
    x, y = (torch.arange(n, dtype=joints.dtype, device=joints.device) + 0.5 for n in size)
    across = torch.exp(-0.5 * ((x - places[..., :1]) / SPREAD) ** 2)
    down = torch.exp(-0.5 * ((y - places[..., 1:]) / SPREAD) ** 2)
    return (amount * across).cumsum(-1), down


def map_distances(reference: Profiles, rendered: Profiles) -> Tensor:
    """E of every joint's map: over all turns, the mean square of the difference of the cumulative sums, summed.

    Args:
        reference: of R = 1 or B frames.
        rendered: of B frames.

    Returns:
        (B, J) [px^2], >= 0.
    """
    (ax, ay), (bx, by) = reference, rendered

    def mean_product(px: Tensor, py: Tensor, qx: Tensor, qy: Tensor) -> Tensor:
        return (px * qx).mean(-1) * (py * qy).mean(-1)

    squares = mean_product(ax, ay, ax, ay) + mean_product(bx, by, bx, by) - 2 * mean_product(ax, ay, bx, by)
    return squares.clamp_min(0).sum(1)


def pair_distances(of: Profiles) -> Tensor:
    """E between the maps of every two joints of one frame, (B, J, J) [px^2]; see :func:`map_distances`."""
    across, down = (part @ part.transpose(-1, -2) / part.shape[-1] for part in of)
    gram = across * down
    own = gram.diagonal(dim1=-2, dim2=-1)
    return (own[..., :, None] + own[..., None, :] - 2 * gram).clamp_min(0).sum(1)


def sharpness(joints: Tensor, size: tuple[int, int]) -> Tensor:
    """kappa of every joint, (B, J), adding up to J: range of the softmax over its map; NaN without any map."""
    ranges = torch.cat([_softmax_ranges(part, size) for part in joints.split(DRAWN)])
    return ranges * ranges.shape[-1] / ranges.sum(-1, keepdim=True)


def _softmax_ranges(joints: Tensor, size: tuple[int, int]) -> Tensor:
    """Range of the softmax over each joint's map, (B, J) float64, with the maps drawn."""
    x, y = (torch.arange(n, dtype=torch.float32, device=joints.device) + 0.5 for n in size)
    places, amount = joints[..., :2].float(), joints[..., 2].float()
    across = torch.exp(-0.5 * ((x - places[..., :1]) / SPREAD) ** 2)
    down = amount[..., None] * torch.exp(-0.5 * ((y - places[..., 1:]) / SPREAD) ** 2)
    maps = (down[..., :, None] * across[..., None, :]).flatten(2).nan_to_num(0)
    soft = torch.softmax(TEMPERATURE * maps, dim=-1)
    return (soft.amax(-1) - soft.amin(-1)).double()


@dataclass(frozen=True)
class _Wanted:
    """What the maps of a reference of R frames come to."""

    kappa: Tensor  # (R, J)
    profiles: Profiles
    pairs: Tensor  # (R, J, J)

    @classmethod
    def of(cls, reference: Features, size: tuple[int, int]) -> _Wanted:
        joints = _on_maps(reference, size)
        made = profiles(joints, size)
        return cls(sharpness(joints, size), made, pair_distances(made))


@LOSSES.register("jaws_pose")
@dataclass(frozen=True)
class JawsPose:
    """0.7 mean(kappa E of each joint's maps) + 0.3 MSE(D), D the kappa E between every two joints of one frame.

    JAWS' on-screen loss, for comparison: the pose of the whole body, arms and all, has to agree. JAWS also blends
    each render's maps with those of the last two steps; a loss has no memory, so this one does not.

    Args:
        quirks: D is weighted by the last joint's kappa throughout, as a leaking loop variable does in the published
            code; otherwise by that of its row's joint.
        weight: of the term; JAWS: 0.3.

    The penalty is above what the maps of a person out of the frame cost.
    """

    quirks: bool = False
    weight: float = 0.3

    requires: ClassVar[tuple[str, ...]] = ("keypoints",)
    unit: ClassVar[str] = "px^2 at 224"
    penalty: ClassVar[float] = 1000.0

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        """Raw loss, (B,); NaN where the reference shows no joint or the render has no person."""
        check_pair(reference, rendered)
        size = (round(HEIGHT * reference.size[0] / reference.size[1]), HEIGHT)
        wanted, found = reference.once("jaws maps", lambda: _Wanted.of(reference, size)), _on_maps(rendered, size)
        kappa, drawn = wanted.kappa, profiles(found, size)
        own = (kappa * map_distances(wanted.profiles, drawn)).mean(-1)
        row = kappa[:, -1:, None] if self.quirks else kappa[..., None]
        apart = row * (pair_distances(drawn) - wanted.pairs)
        pairs = apart.masked_fill(~torch.ones_like(apart, dtype=torch.bool).tril(-1), 0)
        loss = OWN * own + PAIRS * pairs.square().mean((-1, -2))
        nobody = ~torch.isfinite(found[..., :2]).any(-1).any(-1)
        return loss.masked_fill(nobody, float("nan"))


def _on_maps(features: Features, size: tuple[int, int]) -> Tensor:
    """Joints (B, 14, 3) in pixels of maps of ``size``."""
    joints = features.require("keypoints").double()
    scale = joints.new_tensor([size[0] / features.size[0], size[1] / features.size[1], 1.0])
    return joints * scale
