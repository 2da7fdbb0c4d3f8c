"""Framing: where in the frame the person stands (paper Sec. 4.2.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import torch
from torch import Tensor

from ..features import Features, check_pair
from ..placement import frame_joints, hide_unknown, mask_centroid, shows_person, visible_joints
from ..registry import LOSSES


def centroid_difference(reference: Tensor, rendered: Tensor) -> Tensor:
    """Difference of the centroids of the joints that the reference shows (paper Eq. 7).

    Args:
        reference: key joints as x/W, y/H, confidence, (R, J, 3), R = 1 or B.
        rendered: the same of B candidates, (B, J, 3); the confidence is not read.

    Returns:
        (B, 2) [frame]; NaN where the reference shows no joint or the render lacks one of the set.
    """
    shown = visible_joints(reference)[..., None]  # (R, J, 1)
    moved = (rendered[..., :2] - reference[..., :2]).masked_fill(~shown, 0)
    return moved.sum(-2) / shown.sum(-2)  # no joint: 0 / 0 is NaN


def framing_loss(reference: Tensor, rendered: Tensor) -> Tensor:
    """Distance of the centroids of the joints that the reference shows (paper Eq. 6).

    Args:
        reference: key joints as x/W, y/H, confidence, (R, J, 3), R = 1 or B.
        rendered: the same of B candidates, (B, J, 3).

    Returns:
        (B,) [frame], >= 0; NaN where the reference shows no joint or the render lacks one of the set.
    """
    return centroid_difference(reference, rendered).norm(dim=-1)


@LOSSES.register("framing")
@dataclass(frozen=True)
class Framing:
    """Distance of the centroids of the key joints visible in the reference (paper Eq. 6-7).

    The render's joints count where they are, also unseen or out of the frame, so hiding one never pays.

    Args:
        mode: ``faithful`` is undefined where the reference shows no key joint; ``robust`` compares the
            centroids of the subject masks there, and leaves out joints the scene does not know at all.
        joints: key are the paper's five (its Sec. 8.1); all are the 14 of the full pose, which a raised arm changes.
        min_area: smallest mask of the reference that tells anything, in [0, 1] of the frame; ``faithful`` reads none.
        weight: lambda of Eq. 15; tolerance 0.02 of the frame.

    The penalty is the frame's diagonal, 2 ** 0.5: more than two persons inside the frame can be apart. By this loss
    alone a person farther outside than that costs more than nobody at all.
    """

    mode: Literal["robust", "faithful"] = "robust"
    joints: Literal["key", "all"] = "key"
    min_area: float = 0.005
    weight: float = 10.0

    requires: ClassVar[tuple[str, ...]] = ("keypoints", "subject")
    unit: ClassVar[str] = "frame"
    penalty: ClassVar[float] = 2**0.5
    groups: ClassVar[tuple[int, ...]] = (0, 0)
    signs: ClassVar[tuple[str, ...]] = ("further right", "further down")

    def __post_init__(self) -> None:
        if not 0 <= self.min_area <= 1:
            raise ValueError(f"min_area must be in [0, 1], got {self.min_area}")
        if self.mode == "faithful":
            object.__setattr__(self, "requires", ("keypoints",))

    def residuals(self, reference: Features, rendered: Features) -> Tensor:
        """Signed difference of the centroids, (B, 2)."""
        check_pair(reference, rendered)
        shown, joints = frame_joints(reference, self.joints), frame_joints(rendered, self.joints)
        if self.mode == "faithful":
            return centroid_difference(shown, joints)
        shown = hide_unknown(shown, joints)
        by_joints = centroid_difference(shown, joints)
        person = shows_person(shown) & shows_person(joints)
        none = ~visible_joints(shown).any(-1) & person
        if not bool(none.any()):  # masks take longer than all the rest
            return by_joints
        wanted = mask_centroid(reference.require("subject"), self.min_area)  # a render may be as small: no step there
        by_mask = mask_centroid(rendered.require("subject")) - wanted
        return torch.where(none[:, None], by_mask, by_joints)

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        """Raw loss, (B,) [frame]; NaN where undefined."""
        return self.residuals(reference, rendered).norm(dim=-1)
