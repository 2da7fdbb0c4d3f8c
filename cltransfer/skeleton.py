"""The joints everybody speaks about: 14 as in CrowdPose, and the five key joints of the shot size.

Every pose estimator is converted to these 14 at its border, by the same rules for a clip, a render and a lifted
subject. A joint is (x, y, confidence); in the scene it is (x, y, z).
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

JOINTS = (
    "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
    "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle", "head_top", "neck",
)  # fmt: skip

BONES = tuple(  # as pairs of JOINTS
    (JOINTS.index(a), JOINTS.index(b))
    for a, b in (
        ("head_top", "neck"), ("neck", "left_shoulder"), ("neck", "right_shoulder"), ("left_shoulder", "left_elbow"),
        ("left_elbow", "left_wrist"), ("right_shoulder", "right_elbow"), ("right_elbow", "right_wrist"),
        ("left_shoulder", "left_hip"), ("right_shoulder", "right_hip"), ("left_hip", "right_hip"),
        ("left_hip", "left_knee"), ("left_knee", "left_ankle"), ("right_hip", "right_knee"),
        ("right_knee", "right_ankle"),
    )
)  # fmt: skip

# head top, chest, waist, knees, feet: each of one or two parts of JOINTS; two mean their midpoint (paper Sec. 9)
_KEY_PARTS = torch.tensor([(12, 12), (0, 1), (6, 7), (8, 9), (10, 11)])  # (5, 2)

_SHARES = (  # share of the standing height; the hips mean their middle
    ("head_top", "neck", 0.18), ("neck", "hips", 0.29),
    ("left_hip", "left_knee", 0.25), ("left_knee", "left_ankle", 0.235),
    ("right_hip", "right_knee", 0.25), ("right_knee", "right_ankle", 0.235),
)  # fmt: skip

_UPRIGHT = 0.9  # share of what the bones tell, from where on a person stands upright

# The head top lies beyond the ears, seen from the shoulders: ears 0.935, shoulders 0.815, top 1.0 of body height.
HEAD_TOP_BEYOND_EARS = 0.55

VISIBLE = 0.5  # confidence above which a joint counts as visible (paper Sec. 9)


def key_joints(keypoints: Tensor) -> Tensor:
    """The five key joints, (..., 5, C), of 14 joints (..., 14, C).

    The last column is the confidence; a midpoint is as sure as the less sure of its parts.

    >>> joints = torch.zeros(1, 14, 3); joints[0, 0] = torch.tensor([2.0, 4.0, 0.9]); joints[0, 1, 2] = 0.4
    >>> key_joints(joints)[0, 1]
    tensor([1.0000, 2.0000, 0.4000])
    """
    first, second = (keypoints.index_select(-2, part) for part in _KEY_PARTS.to(keypoints.device).unbind(1))
    confidence = torch.minimum(first[..., -1:], second[..., -1:])
    return torch.cat([(first[..., :-1] + second[..., :-1]) / 2, confidence], dim=-1)


def stature(joints: Tensor) -> float:
    """Standing height of joints (14, 3) in the scene, by the lengths of their bones, which no pose changes.

    The median of what the bones tell, so that one joint that is wrong tells little.

    Returns:
        In the units of the joints; NaN where no bone has both of its ends (an unknown joint is NaN).
    """
    at = dict(zip(JOINTS, joints.double()))
    at["hips"] = (at["left_hip"] + at["right_hip"]) / 2
    told = torch.stack([(at[one] - at[other]).norm() / share for one, other, share in _SHARES])
    return float(told.nanquantile(0.5))


def standing_height(reach: float, joints: Tensor) -> float:
    """Standing height of a person who reaches up by ``reach``; of one who leans, sits or lies the bones tell it.

    Args:
        reach: from the soles to the top of the head, in the units of the joints; NaN where unknown.
        joints: (14, 3), NaN where unknown.
    """
    bones = stature(joints)
    return bones if math.isnan(reach) or reach < _UPRIGHT * bones else reach


def head_top(ears: Tensor, shoulders: Tensor) -> Tensor:
    """Head top (..., C) of both ears (..., 2, C) and both shoulders (..., 2, C), confidence last.

    The ears count by their confidence, because in profile one is hidden; one that is not finite does not count. NaN
    where neither does.
    """
    known = ears.isfinite().all(-1, keepdim=True)
    ears = torch.where(known | ~known.any(-2, keepdim=True), ears, 0.0)
    weight = ears[..., -1:].clamp_min(1e-6) * known
    ear = (ears[..., :-1] * weight).sum(-2) / weight.sum(-2)
    shoulder = shoulders[..., :-1].mean(-2)
    confidence = torch.minimum(ears[..., -1].amax(-1), shoulders[..., -1].amin(-1))
    return torch.cat([ear + HEAD_TOP_BEYOND_EARS * (ear - shoulder), confidence[..., None]], dim=-1)


def _from_parts(keypoints: Tensor, body: list[int], ears: list[int]) -> Tensor:
    joints = keypoints[..., body, :]
    shoulders = joints[..., :2, :]
    neck = torch.cat([shoulders[..., :-1].mean(-2), shoulders[..., -1:].amin(-2)], dim=-1)
    top = head_top(keypoints[..., ears, :], shoulders)
    return torch.cat([joints, top[..., None, :], neck[..., None, :]], dim=-2)


def from_coco(keypoints: Tensor) -> Tensor:
    """14 joints (..., 14, C) of COCO's 17 (..., 17, C), confidence last."""
    return _from_parts(keypoints, [5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16], [3, 4])


def from_blazepose(keypoints: Tensor) -> Tensor:
    """14 joints (..., 14, C) of BlazePose's 33 or 39 (..., 33, C), confidence last."""
    return _from_parts(keypoints, [11, 12, 13, 14, 15, 16, 23, 24, 25, 26, 27, 28], [7, 8])


def unseen_outside(joints: Tensor, size: tuple[int, int]) -> Tensor:
    """Joints (..., J, 3) as x, y [px], confidence, with confidence 0 out of a frame of ``size`` (W, H)."""
    inside = ((joints[..., :2] >= 0) & (joints[..., :2] <= joints.new_tensor(size))).all(-1)
    return torch.cat([joints[..., :2], torch.where(inside, joints[..., 2], 0.0)[..., None]], dim=-1)
