"""When a frame and when a clip has failed; written down before anything was compared (docs/protocol.md)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from ..features import Features
from ..search import limits
from ..skeleton import VISIBLE

JOINTS_FOUND = 0.5  # of the joints that the reference shows
LEAST_ALPHA = 0.9  # of the frame that the scene covers; of what it covers for the true camera where that is less
LEAST_SUBJECT = 0.002  # of the frame
NEAR = 0.1  # subject heights: nearer surfaces
NEAR_AREA = 0.05  # may cover so much of the frame
PINNED = 1e-3  # of a parameter's range
FAILED_FRAMES = 0.1  # of a clip
RANDOM_SHARE = 0.5  # of the total that random views have
REASONS = ("not_finite", "joints", "coverage", "subject", "near", "bound")


@dataclass(frozen=True)
class Shown:
    """What N rendered frames show.

    Args:
        features: with keypoints.
        alpha: coverage of the frame by the scene, (N, H, W).
        label: by the subject, (N, H, W).
        depth: (N, H, W), NaN where nothing is.
        height: of the subject, scene units.
    """

    features: Features
    alpha: Tensor  # (N, H, W)
    label: Tensor  # (N, H, W)
    depth: Tensor  # (N, H, W)
    height: float


def cover(alpha: Tensor) -> Tensor:
    """Share of each frame that a scene covers, (N,), of its alpha (N, H, W)."""
    return alpha.flatten(1).double().mean(1)


def failed_frames(
    reference: Features, shown: Shown, true_cover: Tensor, finite: Tensor, pinned: Tensor
) -> Mapping[str, Tensor]:
    """Which frames have failed and why, by reason, (N,) bool each.

    Args:
        reference: N frames with keypoints and subject.
        shown: what was rendered.
        true_cover: share of the frame that the same scene covers for the true cameras, (N,): one without a sky, as a
            grid outdoors, leaves some of it empty whatever is done.
        finite: whether camera and total are finite, (N,) bool.
        pinned: whether a parameter stands at its bound, (N,) bool.
    """
    wanted, there = (features.require("keypoints")[..., 2] > VISIBLE for features in (reference, shown.features))
    found = (wanted & there).sum(1) < JOINTS_FOUND * wanted.sum(1)
    small = (shown.label > 0.5).flatten(1).double().mean(1) < LEAST_SUBJECT
    small &= reference.require("subject").flatten(1).double().mean(1) >= LEAST_SUBJECT
    near = (shown.depth < NEAR * shown.height).flatten(1).double().mean(1) > NEAR_AREA
    bare = cover(shown.alpha) < LEAST_ALPHA * true_cover.where(true_cover < LEAST_ALPHA, 1.0)
    return dict(zip(REASONS, (~finite, found, bare, small, near, pinned)))


def pinned_frames(x: Tensor, search: Any) -> Tensor:
    """Whether a parameter stands at a finite bound that means something, (N,) bool, of vectors x (N, D)."""
    low, high = limits(search, x.shape[1])
    margin = PINNED * (high - low)
    at_bound = torch.isfinite(margin) & ((x <= low + margin) | (x >= high - margin))
    return at_bound.any(1)


def failed_clip(failed: Tensor, total: float, random_total: float) -> bool:
    """Whether a clip has failed: more than a tenth of its frames (N,) bool, or a total that random views reach half of.

    >>> failed_clip(torch.tensor([False] * 24), 3.0, 10.0)
    False
    >>> failed_clip(torch.tensor([False] * 24), 6.0, 10.0)
    True
    """
    return bool(failed.double().mean() > FAILED_FRAMES) or not total <= RANDOM_SHARE * random_total
