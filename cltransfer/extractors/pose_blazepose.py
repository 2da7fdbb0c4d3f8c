"""Joints, person mask and body orientation by BlazePose (https://arxiv.org/abs/2006.10204)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Literal

import numpy as np
import torch
from torch import Tensor

from ..features import Features
from ..models.onnx import Network
from ..models.places import find_model
from ..orientation import orientation_from_axes
from ..registry import EXTRACTORS
from ..skeleton import from_blazepose, unseen_outside
from ._crops import Crops, about_boxes
from ._pixels import to_uint8

SIDE = 256  # of the crop the network sees [px]
MARGIN = 1.25  # side of the crop over the longer side of the person
CUT = 0.04  # a box that ends this near the lower edge [frame heights] shows a body that goes on below
STANDING = 3.0  # height over width of a standing body
LYING = 2.0  # width over height of what no standing body shows, but where the upper edge cuts it too
GIVES = ("keypoints", "subject", "orientation")
HIPS, BODY = 33, 34  # auxiliary landmarks: middle of the hips, and a point of the circle about the whole body
LEFT_SHOULDER, RIGHT_SHOULDER, LEFT_HIP, RIGHT_HIP = 11, 12, 23, 24


@dataclass(frozen=True)
class Poses:
    """What one pass says of N persons, in pixels and axes of their frames.

    Args:
        landmarks: (N, 39, 3) as x, y [px], visibility in [0, 1].
        world: (N, 39, 3) about the hips [m], x right, y down, z forward.
        mask: logits over the crop, (N, SIDE, SIDE).
        presence: (N,) in [0, 1].
        crops: where they were read.
    """

    landmarks: np.ndarray
    world: np.ndarray
    mask: np.ndarray
    presence: np.ndarray
    crops: Crops

    def __getitem__(self, keep: np.ndarray) -> Poses:
        crops = Crops(self.crops.center[keep], self.crops.side[keep], self.crops.up[keep], SIDE)
        return Poses(self.landmarks[keep], self.world[keep], self.mask[keep], self.presence[keep], crops)


def whole_bodies(boxes: np.ndarray, height: int) -> np.ndarray:
    """Boxes (N, 4) as x, y, width, height [px]; those cut by the lower edge of the frame go on to the feet.

    The network wants the hips in the middle of its crop. In a medium shot they are not in the middle of what is
    seen, and then it squeezes the body into the box: the waist climbs to the chest and pitch is off by 50 degrees.
    """
    grown = boxes.copy()
    cut = boxes[:, 1] + boxes[:, 3] >= (1 - CUT) * height
    cut &= (boxes[:, 2] <= LYING * boxes[:, 3]) | (boxes[:, 1] <= CUT * height)  # a close-up ends at both edges
    grown[cut, 3] = np.maximum(boxes[cut, 3], STANDING * boxes[cut, 2])
    return grown


def about_landmarks(landmarks: np.ndarray) -> Crops:
    """Squares about the hips in which the body stands upright, of landmarks (N, 39, 2 or more)."""
    hips = landmarks[:, HIPS, :2]
    axis = landmarks[:, BODY, :2] - hips
    radius = np.maximum(np.linalg.norm(axis, axis=1), 1.0)
    return Crops(hips, 2 * MARGIN * radius, axis / radius[:, None], SIDE)


def body_orientation(world: Tensor) -> Tensor:
    """Yaw, pitch, roll (N, 3) [rad] of landmarks (N, 39, 3), seen along the optical axis.

    The network reads the crop as if the camera pointed at it, so the body is on the axis of that camera.
    """
    shoulders, hips = world[:, [LEFT_SHOULDER, RIGHT_SHOULDER]], world[:, [LEFT_HIP, RIGHT_HIP]]
    left = shoulders[:, 0] - shoulders[:, 1] + hips[:, 0] - hips[:, 1]
    return orientation_from_axes(left, shoulders.mean(1) - hips.mean(1), world.new_tensor([0.0, 0.0, -1.0]))


@EXTRACTORS.register("pose_blazepose")
@dataclass(frozen=True)
class PoseBlazepose:
    """14 joints, the person's pixels and the orientation of one person per frame, from one look at its box.

    The confidence of a joint is the network's visibility, 0 out of the frame. Without a box or below
    ``min_presence`` joints and orientation are NaN and the mask is empty.

    Args:
        model: ONNX file, ``input`` (1, 3, 256, 256) RGB in [0, 1] -> ``output0`` (1, 195) 39 landmarks, ``output1``
            (1, 1) presence, ``output2`` (1, 1, 256, 256) mask, ``output4`` (1, 117) world landmarks; where the file has
            other names each is known by its shape, channels first or last.
        second_crop: look again at a crop that the first look's landmarks centre and turn upright.
        min_presence: probability of a person that counts as one, in [0, 1]; by 0 every box has one, so that none is
            guessed where the detector loses the person.
        give: what of joints (``keypoints``), person's pixels (``subject``) and ``orientation`` to provide, so that
            other networks can give the rest.
    """

    requires: ClassVar[tuple[str, ...]] = ("image", "box")
    provides: ClassVar[tuple[str, ...]] = GIVES
    family: ClassVar[Literal["image", "scene", "both"]] = "image"
    doubts_boxes: ClassVar[bool] = True  # by min_presence, unless it is 0
    model: str = "mp_pose_landmark_lite.onnx"
    second_crop: bool = True
    min_presence: float = 0.5
    give: tuple[str, ...] = GIVES

    def __post_init__(self) -> None:
        if not self.give or set(self.give) - set(GIVES):
            raise ValueError(f"give must be some of {', '.join(GIVES)}, got {', '.join(self.give) or 'none'}")
        object.__setattr__(self, "provides", tuple(name for name in GIVES if name in self.give))
        if not 0 <= self.min_presence <= 1:
            raise ValueError(f"min_presence must be in [0, 1], got {self.min_presence}")
        object.__setattr__(self, "doubts_boxes", self.min_presence > 0)

    @property
    def passes(self) -> int:
        """Network passes one frame costs."""
        return 2 if self.second_crop else 1

    @cached_property
    def network(self) -> Network:
        """The pose network."""
        landmarks, presence, mask = (None, 195), (None, 1), (None, 1, SIDE, SIDE)
        outputs = {"output0": landmarks, "output1": presence, "output2": mask, "output4": (None, 117)}
        return Network(find_model(self.model), {"input": (None, 3, SIDE, SIDE)}, outputs, by_shape=True)

    def __call__(self, now: Features, before: Features | None = None) -> Features:
        """``now`` with what it gives of ``keypoints``, ``subject`` and ``orientation``.

        Raises:
            ModelError: the network is missing or refused.
        """
        image, box = now.require("image"), now.require("box")
        count, _, height, width = image.shape
        scale = np.array([now.size[0] / width, now.size[1] / height])  # image -> size
        rows, poses = self._poses(to_uint8(image), box[:, :4].double().cpu().numpy() / np.tile(scale, 2))
        keypoints, orientation = torch.full((count, 14, 3), torch.nan), torch.full((count, 3), torch.nan)
        subject = torch.zeros((count, height, width), dtype=torch.bool)
        if poses is not None:
            landmarks = torch.from_numpy(poses.landmarks * np.append(scale, 1.0)).float()
            keypoints[rows] = unseen_outside(from_blazepose(landmarks), now.size)
            orientation[rows] = body_orientation(torch.from_numpy(poses.world).float())
            subject[rows] = torch.from_numpy(poses.crops.paste(poses.mask, (width, height), -1.0) > 0)
        found = {"keypoints": keypoints, "subject": subject, "orientation": orientation}
        given: dict[str, Any] = {name: found[name].to(image.device) for name in self.provides}
        return replace(now, **given)

    def _poses(self, images: np.ndarray, boxes: np.ndarray) -> tuple[np.ndarray, Poses | None]:
        """Indices of the frames with a person and their poses, None if there is none."""
        rows = np.flatnonzero(np.isfinite(boxes).all(axis=1))
        crops, poses = about_boxes(whole_bodies(boxes[rows], images.shape[1]), MARGIN, SIDE), None
        for _ in range(self.passes):
            if len(rows) == 0:
                return rows, None
            poses = self._look(images[rows], crops)
            sure = poses.presence >= self.min_presence
            rows, poses = rows[sure], poses[sure]
            crops = about_landmarks(poses.landmarks)
        return rows, poses

    def _look(self, images: np.ndarray, crops: Crops) -> Poses:
        rgb = crops.cut(images).transpose(0, 3, 1, 2).astype(np.float32) / 255
        got = self.network({"input": rgb})
        landmarks = got["output0"].reshape(-1, 39, 5).astype(np.float64)
        visibility = torch.sigmoid(torch.from_numpy(landmarks[..., 3:4])).numpy()
        world = got["output4"].reshape(-1, 39, 3).astype(np.float64)
        return Poses(
            np.concatenate([crops.to_frame(landmarks[..., :2]), visibility], axis=-1),
            np.concatenate([world[..., :2] @ crops.turn, world[..., 2:]], axis=-1),
            got["output2"][:, 0],
            got["output1"][:, 0],
            crops,
        )
