"""Where the person stands in the frame, for losses that compare it and searches that match it.

Frames are one wide and one high.
"""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor

from .features import Features
from .skeleton import VISIBLE, key_joints


def frame_joints(features: Features, which: Literal["key", "all"] = "key") -> Tensor:
    """The five key joints, or all 14, as x/W, y/H and confidence, (B, J, 3)."""

    def read() -> Tensor:
        keypoints = features.require("keypoints")
        joints: Tensor = key_joints(keypoints) if which == "key" else keypoints
        return joints / joints.new_tensor([*features.size, 1])

    return features.once(("joints", which), read)


def visible_joints(joints: Tensor) -> Tensor:
    """Which of the joints (B, J, 3) are visible, (B, J) bool: sure enough and somewhere."""
    return (joints[..., 2] > VISIBLE) & joints[..., :2].isfinite().all(-1)


def shows_person(joints: Tensor) -> Tensor:
    """Which of B frames know where a person is, (B,) bool, in the frame or not: some of the joints (B, J, 3) is."""
    return joints[..., :2].isfinite().all(-1).any(-1)


def hide_unknown(reference: Tensor, rendered: Tensor) -> Tensor:
    """``reference`` joints (B, J, 3) with confidence 0 where the render does not know the joint.

    A scene may lack a joint for good (a sign hides the feet from every view); no camera can answer for it.
    Where the render knows no joint at all nothing is hidden: then the person is missing.
    """
    known = rendered[..., :2].isfinite().all(-1)  # (B, J)
    hidden = ~known & known.any(-1, keepdim=True)
    reference = reference.expand(len(rendered), -1, -1)
    return torch.cat([reference[..., :2], reference[..., 2:].masked_fill(hidden[..., None], 0)], dim=-1)


def mask_extent(mask: Tensor, least: float = 0.0) -> Tensor:
    """Width and height of the mask (B, H, W) bool as parts of the frame, (B, 2).

    NaN where it is empty, or covers less than ``least`` of the frame.
    """

    def extent(line: Tensor) -> Tensor:  # (B, N) bool
        first = line.int().argmax(-1)
        last = line.shape[-1] - line.flip(-1).int().argmax(-1)
        return ((last - first) / line.shape[-1]).masked_fill(~line.any(-1), float("nan"))

    found = torch.stack([extent(mask.any(-2)), extent(mask.any(-1))], dim=-1)
    return found.masked_fill(_small(mask, least), float("nan"))


def mask_centroid(mask: Tensor, least: float = 0.0) -> Tensor:
    """Centroid of the mask (B, H, W) bool as x/W and y/H, (B, 2).

    NaN where it is empty, or covers less than ``least`` of the frame.
    """

    def mean(line: Tensor) -> Tensor:  # (B, N) pixel counts
        centres = (torch.arange(line.shape[-1], device=line.device) + 0.5) / line.shape[-1]
        return (line * centres).sum(-1) / line.sum(-1)

    found = torch.stack([mean(mask.sum(-2)), mean(mask.sum(-1))], dim=-1)
    return found.masked_fill(_small(mask, least), float("nan"))


def _small(mask: Tensor, least: float) -> Tensor:
    """Masks (B, H, W) that cover less than ``least`` of the frame, (B, 1) bool."""
    return (mask.flatten(1).double().mean(1) < least)[:, None]
