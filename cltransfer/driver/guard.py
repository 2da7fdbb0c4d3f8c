"""Where a camera may not stand: inside something, before nothing, or where the person is hidden, or hidden in part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ..feature_shapes import on_grid
from ..features import Features
from ..skeleton import VISIBLE
from ..subject import Subject

BODY = 0.12  # subject heights; a camera nearer to the middle line of the body is inside it
NEAR, NEAR_PERSON = 0.3, 0.15  # subject heights; things, and the person, that are nearer stand right before the lens
CLOSE = 0.4  # of the frame that may be so near
COVERAGE = 0.05  # of the frame that must show something, unless the person is seen: a scene may be nothing else
SHOWN = 0.03  # of the joints' box that must show the person

EMPTY = "the view is almost empty"
HIDDEN, PARTLY = "the person is hidden", "things hide part of the person"
READ = frozenset({"subject", "keypoints"})  # what tells whether the person is hidden, beside depth
SCENE_DEPTH = "scene_depth"  # extra of a view whose ``depth`` is a network's, in a unit that nobody knows


@dataclass(frozen=True)
class Guard:
    """Views that a search must not take, whatever the losses say of them.

    The losses read joints that may be behind a wall, and a view from inside a body has a depth too.

    Args:
        height: of the subject, scene units; None leaves out what is measured in it.
        hidden: share in [0, 1] of the joints that a reference shows, and the view has in its frame, that may be hidden;
            1 asks nothing of single joints.
    """

    height: float | None
    hidden: float = 1.0

    def reasons(self, features: Features, reference: Features | None = None) -> dict[str, Tensor]:
        """What is wrong with B views, (B,) bool by reason; needs ``depth`` as the scene has it.

        Where the ``reference``, 1 or B frames, shows nobody, the person may be hidden. There, or where its foreground
        fills over :data:`CLOSE`, things may come as near as the person.
        """
        depth = features.require(SCENE_DEPTH if features.has(SCENE_DEPTH) else "depth")  # (B, H, W)
        wrong = {EMPTY: torch.isfinite(depth).double().flatten(1).mean(1) < COVERAGE}
        if features.has("subject"):
            wrong[EMPTY] &= ~features.require("subject").flatten(1).any(1)
        if self.height is not None:
            person = _person(features, depth.shape[1:]).flatten(1)
            nearest = torch.where(person | _filled(reference), NEAR_PERSON, NEAR) * self.height
            wrong["the camera stands inside something"] = (depth.flatten(1) < nearest).double().mean(1) > CLOSE
        if features.person is not None and features.camera is not None:
            inside = _from_body(features.camera.center, features.person) < BODY * features.person.height
            wrong["the camera stands inside the person"] = inside
        if all(features.has(name) for name in READ):
            wrong[HIDDEN] = _hidden(features)
            if reference is not None and reference.has("keypoints"):
                shown = reference.require("keypoints")[..., 2] > VISIBLE
                wrong[HIDDEN] &= shown.any(1)
                if self.hidden < 1:
                    wrong[PARTLY] = hidden_share(features, shown) > self.hidden
        return wrong

    def blocked(self, features: Features, reference: Features | None = None) -> Tensor:
        """Views that may not be taken, (B,) bool; see :meth:`reasons`."""
        return torch.stack(list(self.reasons(features, reference).values())).any(0)


def _person(features: Features, grid: Sequence[int]) -> Tensor:
    """Pixels of ``grid`` (H, W) that may show the person, (B, H, W) or (1, 1, 1) bool; all where nobody told."""
    if not features.has("subject"):
        return torch.ones(1, 1, 1, dtype=torch.bool)
    return on_grid(features.require("subject"), grid)  # a network's may have fewer pixels


def _filled(reference: Features | None) -> Tensor:
    """Frames of the reference that what is before the person fills, or hides them, (R, 1) bool; none where untold."""
    if reference is None:
        return torch.zeros(1, 1, dtype=torch.bool)
    return reference.once("filled by what is before the person", lambda: _filled_frames(reference))


def _filled_frames(reference: Features) -> Tensor:
    filled = torch.zeros(len(reference), 1, dtype=torch.bool)
    if reference.has("layers"):
        filled |= reference.require("layers")[:, :1].flatten(1).double().mean(1, keepdim=True) > CLOSE
    if reference.has("subject"):
        filled |= ~reference.require("subject").flatten(1).any(1, keepdim=True)
    return filled


def _from_body(points: Tensor, person: Subject) -> Tensor:
    """Distance (B,) of points (B, 3) to the line from key joint to key joint, scene units."""
    known = person.key_joints[:, :3][person.key_joints[:, 3] > 0]  # (K, 3), from head to feet
    if len(known) < 2:
        return torch.full((len(points),), torch.inf, dtype=torch.float64)
    start, along = known[:-1], known[1:] - known[:-1]
    offset = points[:, None] - start  # (B, K - 1, 3)
    length = (along**2).sum(-1).clamp_min(1e-12)  # two joints may be one
    share = ((offset * along).sum(-1) / length).clamp(0, 1)
    return (offset - share[..., None] * along).norm(dim=-1).amin(1)


def hidden_share(features: Features, shown: Tensor) -> Tensor:
    """Share (B,) of the joints ``shown``, (R, 14) bool, that B views have in the frame, behind something.

    0 where the frame has none of them, or the person's own joints are not known.
    """
    if features.person is None:
        return torch.zeros(len(features), dtype=torch.float64)
    keypoints = features.require("keypoints")
    size = keypoints.new_tensor(features.size)
    inside = ((keypoints[..., :2] >= 0) & (keypoints[..., :2] < size)).all(-1)
    there = inside & shown & (features.person.confidence > VISIBLE)
    return (there & ~(keypoints[..., 2] > VISIBLE)).double().sum(1) / there.double().sum(1).clamp_min(1)


def _hidden(features: Features) -> Tensor:
    """Views in which the joints' box lies in the frame and shows almost nothing of the person, (B,) bool."""
    size = torch.tensor(features.size, dtype=torch.float64)
    joints = features.require("keypoints")[..., :2].double() / size  # (B, 14, 2) [frame]
    unknown = ~torch.isfinite(joints)
    low = joints.masked_fill(unknown, torch.inf).amin(1).clamp(0, 1)
    high = joints.masked_fill(unknown, -torch.inf).amax(1).clamp(0, 1)
    box = (high - low).clamp_min(0).prod(-1)  # [frame]
    shown = features.require("subject").flatten(1).double().mean(1)
    return (box > 0) & (shown < SHOWN * box)
