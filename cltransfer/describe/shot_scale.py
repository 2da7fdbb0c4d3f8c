"""The shot scale in a cinematographer's classes, by the joints that the frame holds (paper Sec. 8.1)."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..features import Features
from ..placement import frame_joints, visible_joints
from ..skeleton import JOINTS

SCALES = ("ECU", "CU", "MCU", "MS", "MLS", "LS", "ELS")
SCALE_NAMES = (
    *("extreme close-up", "close-up", "medium close-up", "medium shot", "medium long shot", "long shot"),
    "extreme long shot",
)

# head top, chest, waist, knees, feet of a standing body, as parts of its height from above
LEVELS = (0.0, 0.185, 0.47, 0.715, 0.961)

# Amount of the body, in its heights, from which the next class begins: less than a face is ECU; a head with the neck,
# cut below the shoulders, CU; cut at the chest MCU; below the waist MS; above or through the knees MLS; with the shins
# LS; and where the frame is four bodies high, ELS.
BOUNDS = (0.11, 0.24, 0.37, 0.55, 0.85, 2.0)

WIDTH = 0.15  # body heights from the key joints, that shoulders and arms reach to either side

# Seen from above or below a body gets shorter, at last a point, but its shoulders do not. Up to FORESHORTENED of pitch
# its length counts as it is seen, 0.7 of it there: what is read of a level view is not to depend on how well pitch is.
FORESHORTENED = math.radians(45)
SHOULDERS = 4.0  # body's height over how far apart its shoulder joints are, of a broad person; slim ones have 5
POINT = 1e6  # half the frame's length in body heights from which a body is a point, which tells no length

LEAST_FILLED = 0.5  # a body cut by the frame counts for at least so much of the frame's length: it is leaving, not near


def shot_scale(features: Features) -> Tensor:
    """Class of each frame: index into :data:`SCALES`, (N,) int64, closest first; -1 where no scale can be told.

    Needs ``keypoints``. The visible key joints say where the body is; where fewer than two are, as in a close-up, those
    that are unseen but placed do. Where ``orientation`` is known a body seen from steeply above or below is no smaller.
    """
    return scale_class(body_in_frame(frame_joints(features), features.size, _steep_shoulders(features)))


def scale_class(amount: Tensor) -> Tensor:
    """Class (N,) of the amount of the body in the frame (N,) as :func:`body_in_frame` measures it; NaN is -1.

    >>> [SCALES[i] for i in scale_class(torch.tensor([0.08, 0.45, 0.96, 3.0]))]
    ['ECU', 'MS', 'LS', 'ELS']
    """
    found = torch.bucketize(amount.contiguous(), amount.new_tensor(BOUNDS), right=True)
    return found.masked_fill(amount.isnan(), -1)


def body_in_frame(joints: Tensor, size: tuple[int, int], shoulders: Tensor | None = None) -> Tensor:
    """How much of a body the frame holds along the body.

    Only the frame's edges across the body cut it: one who stands at the side is no closer. Joints that are not known
    lie on the line through those that are, by the proportions of a standing body.

    Args:
        joints: key joints as x/W, y/H, confidence, (N, 5, 3).
        size: (W, H) of the frame, any unit.
        shoulders: how far apart they are where they tell the body's length better than it does itself, (N,) in the unit
            of ``size``; 0 elsewhere. None: nowhere.

    Returns:
        (N,) [body heights]: the part of the body inside, in [0, 0.961]; more where the frame could hold more than
        twice of it: then half the frame's length in body heights. NaN with fewer than two joints, where none of the
        body is in the frame, and where it is a point.
    """
    pixels = joints[..., :2] * joints.new_tensor(size)
    placed = pixels.isfinite().all(-1)
    visible = visible_joints(joints)
    known = torch.where(visible.sum(-1, keepdim=True) >= 2, visible, placed)
    chain, slope = _completed(pixels, known)
    along = slope.abs().argmax(-1)  # 0: lying, 1: upright
    rows = torch.arange(len(chain))
    position = chain[rows, :, along] / chain.new_tensor(size)[along][:, None]  # (N, 5), in [0, 1] inside
    levels = chain.new_tensor(LEVELS)
    shown = (_inside(position[:, :-1], position[:, 1:]) * levels.diff()).sum(-1)
    body = (chain[:, 1:] - chain[:, :-1]).norm(dim=-1).sum(-1) / levels[-1]  # [px]
    if shoulders is not None:
        body = torch.maximum(body, torch.where(known[:, 1], SHOULDERS * shoulders, 0.0))
    filled = LEAST_FILLED * chain.new_tensor(size)[along] / body
    absent = (shown <= 0) | _beside(chain[rows, :, 1 - along], body, size=chain.new_tensor(size)[1 - along])
    untold = (known.sum(-1) < 2) | absent | (filled > POINT)
    return torch.maximum(shown, filled).masked_fill(untold, float("nan"))


def _steep_shoulders(features: Features) -> Tensor | None:
    """How far apart the shoulders are in frames that look steeply down or up, (N,) [px]; 0 in others."""
    if not features.has("orientation"):
        return None
    left, right = (features.require("keypoints")[:, JOINTS.index(f"{side}_shoulder"), :2] for side in ("left", "right"))
    return torch.where(features.require("orientation")[:, 1].abs() > FORESHORTENED, (left - right).norm(dim=-1), 0.0)


def _beside(across: Tensor, body: Tensor, size: Tensor) -> Tensor:
    """Whether a body (N,) with key joints at ``across`` (N, 5) stands beside a frame of ``size`` (N,), all [px]."""
    reach = WIDTH * body
    return (across.amax(-1) + reach < 0) | (across.amin(-1) - reach > size)


def _completed(pixels: Tensor, known: Tensor) -> tuple[Tensor, Tensor]:
    """Key joints (N, 5, 2) with the unknown ones on the line fitted to the known, and its slope (N, 2) [px/height]."""
    levels, weight = pixels.new_tensor(LEVELS), known.to(pixels)
    there = pixels.masked_fill(~known[..., None], 0)
    count = weight.sum(-1, keepdim=True)
    middle = (weight * levels).sum(-1, keepdim=True) / count  # (N, 1)
    offset = weight * (levels - middle)  # (N, 5)
    slope = (offset[..., None] * there).sum(1) / (offset * levels).sum(-1, keepdim=True)
    line = (there.sum(1) / count)[:, None] + (levels - middle)[..., None] * slope[:, None]
    return torch.where(known[..., None], there, line), slope


def _inside(start: Tensor, end: Tensor) -> Tensor:
    """Part of each segment from ``start`` to ``end`` that lies in [0, 1], in [0, 1]; a point is in or out."""
    low, high = torch.minimum(start, end), torch.maximum(start, end)
    length = high - low
    part = (high.clamp(0, 1) - low.clamp(0, 1)).clamp_min(0) / length.clamp_min(1e-9)
    return torch.where(length > 1e-9, part, ((low >= 0) & (low <= 1)).to(part))
