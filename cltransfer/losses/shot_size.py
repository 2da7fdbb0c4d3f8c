"""Shot size: how much of the frame the person takes (paper Sec. 4.2.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import torch
from torch import Tensor

from ..features import Features, check_pair
from ..placement import frame_joints, hide_unknown, mask_extent, shows_person, visible_joints
from ..registry import LOSSES


def key_joint_extents(reference: Tensor, rendered: Tensor) -> tuple[Tensor, Tensor]:
    """d_ref and d_S of the pair of key joints and the axis that the reference chooses (paper Eq. 4-5).

    Args:
        reference: key joints as x/W, y/H, confidence, (R, J, 3), R = 1 or B.
        rendered: the same of B candidates, (B, J, 3); the confidence is not read.

    Returns:
        (B,) each [frame]; d_ref is NaN where the reference shows fewer than two joints, d_S where the render lacks
        one of the pair.
    """
    visible = visible_joints(reference)
    pairs = (visible[:, :, None] & visible[:, None, :])[..., None]
    gaps = _gaps(reference).masked_fill(~pairs, -1).flatten(1)  # (R, J * J * 2)
    d_ref, chosen = gaps.max(1, keepdim=True)  # Eq. 4
    d_S = _gaps(rendered).flatten(1).gather(1, chosen.expand(len(rendered), 1))  # Eq. 5
    few = visible.sum(1) < 2
    return d_ref[:, 0].masked_fill(few, float("nan")).expand(len(rendered)), d_S[:, 0]


def key_joint_difference(reference: Tensor, rendered: Tensor) -> Tensor:
    """d_S - d_ref, (B,) [frame], of key joints as in :func:`key_joint_extents`; NaN where either is."""
    d_ref, d_S = key_joint_extents(reference, rendered)
    return d_S - d_ref


def _gaps(joints: Tensor) -> Tensor:
    return (joints[:, :, None, :2] - joints[:, None, :, :2]).abs()


def extent_difference(reference: Tensor, rendered: Tensor) -> Tensor:
    """Difference of the subject masks' extents along the reference's longer one.

    Args:
        reference: width and height of the mask, (R, 2) in [0, 1], R = 1 or B.
        rendered: the same of B candidates, (B, 2).

    Returns:
        (B,) [frame]; NaN where a mask is empty.
    """
    axis = reference.argmax(1, keepdim=True).expand(len(rendered), 1)
    return (rendered.gather(1, axis) - reference.expand(len(rendered), 2).gather(1, axis))[:, 0]


def shot_size_loss(reference: Tensor, rendered: Tensor) -> Tensor:
    """Difference in shot size (paper Eq. 3).

    Args:
        reference: key joints as x/W, y/H, confidence, (R, J, 3), R = 1 or B.
        rendered: the same of B candidates, (B, J, 3).

    Returns:
        (B,) [frame], >= 0; NaN where the reference shows fewer than two joints or the render lacks one.
    """
    return key_joint_difference(reference, rendered).abs()


def degenerate(reference: Features, joints: Literal["key", "all"] = "key") -> Tensor:
    """Frames whose shot size no pair of ``joints`` tells, (B,) bool: fewer than two are visible."""
    return visible_joints(frame_joints(reference, joints)).sum(-1) < 2


@LOSSES.register("shot_size")
@dataclass(frozen=True)
class ShotSize:
    """Difference in the part of the frame that the visible key joints span (paper Eq. 3-5).

    Args:
        mode: ``faithful`` is undefined where the reference shows fewer than two key joints; ``robust``
            compares the extents of the subject masks there, and leaves out joints the scene does not know.
        joints: key are the paper's five (its Sec. 8.1); all are the 14 of the full pose, which a raised arm changes.
        min_area: smallest mask of the reference that tells anything, in [0, 1] of the frame; ``faithful`` reads none.
        weight: lambda of Eq. 15; the total is 1 when every loss is at its tolerance, here 0.02 of the frame.

    The penalty is 1 frame: more than any two persons inside the frame can differ by.
    """

    mode: Literal["robust", "faithful"] = "robust"
    joints: Literal["key", "all"] = "key"
    min_area: float = 0.005
    weight: float = 10.0

    requires: ClassVar[tuple[str, ...]] = ("keypoints", "subject")
    unit: ClassVar[str] = "frame"
    penalty: ClassVar[float] = 1.0
    groups: ClassVar[tuple[int, ...]] = (0,)
    signs: ClassVar[tuple[str, ...]] = ("larger",)

    def __post_init__(self) -> None:
        if not 0 <= self.min_area <= 1:
            raise ValueError(f"min_area must be in [0, 1], got {self.min_area}")
        if self.mode == "faithful":
            object.__setattr__(self, "requires", ("keypoints",))

    def residuals(self, reference: Features, rendered: Features) -> Tensor:
        """Signed difference d_S - d_ref, (B, 1)."""
        check_pair(reference, rendered)
        shown, joints = frame_joints(reference, self.joints), frame_joints(rendered, self.joints)
        if self.mode == "faithful":
            return key_joint_difference(shown, joints)[:, None]
        shown = hide_unknown(shown, joints)
        by_joints = key_joint_difference(shown, joints)
        person = shows_person(shown) & shows_person(joints)
        few = (visible_joints(shown).sum(-1) < 2) & person
        if not bool(few.any()):  # masks take longer than all the rest
            return by_joints[:, None]
        wanted = mask_extent(reference.require("subject"), self.min_area)  # a render may be as small: no step there
        by_mask = extent_difference(wanted, mask_extent(rendered.require("subject")))
        return torch.where(few, by_mask, by_joints)[:, None]

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        """Raw loss, (B,) [frame]; NaN where undefined."""
        return self.residuals(reference, rendered)[:, 0].abs()
