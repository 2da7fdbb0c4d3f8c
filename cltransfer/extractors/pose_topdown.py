"""14 joints of one person by any top-down network: HRNet, ViTPose, RTMPose."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np
import torch

from ..features import Features
from ..models.onnx import Network
from ..models.places import find_model
from ..registry import EXTRACTORS
from ..skeleton import from_coco, unseen_outside
from ._crops import Crops, about_boxes
from ._heatmaps import dark_offset, peaks, quarter_offset, simcc_joints
from ._pixels import MOST, normalised, require_input, to_uint8

COUNTS = {"coco": 17, "crowdpose": 14}


@EXTRACTORS.register("pose_topdown")
@dataclass(frozen=True)
class PoseTopdown:
    """14 joints of the person in each box; the paper's are those of HRNet trained on CrowdPose (Sec. 9).

    The confidence of a joint is the peak of its heatmap (of SimCC the smaller of both peaks), 0 out of the
    frame; NaN without a box. CrowdPose's joints are ours; of COCO's the head top is extrapolated.

    Args:
        model: ONNX file, RGB (1 or B, 3, height, width) normalised as ImageNet -> heatmaps (1 or B, J, h, w), or
            ``simcc_x`` and ``simcc_y`` (1 or B, J, bins).
        decode: how a joint is read off. Of heatmaps: ``quarter`` (HRNet), ``dark`` (HRNet trained with DARK),
            ``udp`` (ViTPose, and HRNet trained with UDP: heatmap and input are aligned at their corners' centres).
            ``simcc`` (RTMPose).
        joints: what the network was trained on.
        width: of the network's input [px].
        height: likewise.
        margin: side of the crop over that of the box, once the box has the input's aspect, >= 1.
        input: name of the input.
        output: name of the heatmaps.
    """

    requires: ClassVar[tuple[str, ...]] = ("image", "box")
    provides: ClassVar[tuple[str, ...]] = ("keypoints",)
    family: ClassVar[Literal["image", "scene", "both"]] = "image"
    passes: ClassVar[int] = 1
    model: str
    decode: Literal["quarter", "dark", "udp", "simcc"]
    joints: Literal["coco", "crowdpose"]
    width: int = 192
    height: int = 256
    margin: float = 1.25
    input: str = "input"
    output: str = "output"

    def __post_init__(self) -> None:
        if self.decode not in ("quarter", "dark", "udp", "simcc"):
            raise ValueError(f"decode must be quarter, dark, udp or simcc, got {self.decode!r}")
        if self.joints not in COUNTS:
            raise ValueError(f"joints must be coco or crowdpose, got {self.joints!r}")
        if not 8 <= min(self.width, self.height) <= max(self.width, self.height) <= MOST:
            raise ValueError(f"width and height must be 8 to {MOST}, got {self.width} and {self.height}")
        if self.margin < 1:
            raise ValueError(f"margin must be at least 1, got {self.margin}")

    @cached_property
    def network(self) -> Network:
        """The pose network."""
        names = ("simcc_x", "simcc_y") if self.decode == "simcc" else (self.output,)
        rest = (None,) if self.decode == "simcc" else (None, None)
        outputs = dict.fromkeys(names, (None, COUNTS[self.joints], *rest))
        return Network(find_model(self.model), {self.input: (None, 3, self.height, self.width)}, outputs)

    def __call__(self, now: Features, before: Features | None = None) -> Features:
        """``now`` with ``keypoints``.

        Raises:
            ModelError: the network is missing or refused.
        """
        image, box = now.require("image"), now.require("box")
        scale = np.array([now.size[0] / image.shape[3], now.size[1] / image.shape[2]])  # image -> size
        boxes = box[:, :4].double().cpu().numpy() / np.tile(scale, 2)
        rows = np.flatnonzero(np.isfinite(boxes).all(axis=1))
        keypoints = torch.full((len(image), 14, 3), torch.nan)
        if len(rows):
            found = torch.from_numpy(self._look(to_uint8(image[rows]), boxes[rows]) * np.append(scale, 1.0)).float()
            joints = from_coco(found) if self.joints == "coco" else found
            keypoints[rows] = unseen_outside(joints, now.size)
        return replace(now, keypoints=keypoints.to(image.device))

    def _look(self, images: np.ndarray, boxes: np.ndarray) -> np.ndarray:
        """Joints (N, J, 3) as x, y [px of the image], confidence, of ``images`` (N, H, W, 3) uint8."""
        crops = self._crops(boxes)
        require_input(self.model, len(images), (crops.size, crops.size), "make its width and height smaller")
        left, top = (crops.size - self.width) // 2, (crops.size - self.height) // 2
        seen = crops.cut(images)[:, top : top + self.height, left : left + self.width]
        places, scores = self._decode(self.network({self.input: normalised(seen)}))
        corners = places + 0.5 + np.array([left, top])  # centre at 0 -> corner at 0, in the square
        return np.concatenate([crops.to_frame(corners), np.clip(scores, 0, 1)[..., None]], axis=-1)

    def _crops(self, boxes: np.ndarray) -> Crops:
        """Squares whose middle, ``width`` by ``height``, holds boxes (N, 4) with the margin about them."""
        longer = max(self.width, self.height)
        filled = boxes.copy()
        filled[:, 2:] = (boxes[:, 2:] * longer / np.array([self.width, self.height])).max(axis=1, keepdims=True)
        filled[:, :2] += (boxes[:, 2:] - filled[:, 2:]) / 2
        return about_boxes(filled, self.margin, longer)

    def _decode(self, got: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Places (N, J, 2) [px of the input, the first pixel's centre at 0] and scores (N, J)."""
        size = np.array([self.width, self.height])
        if self.decode == "simcc":
            return simcc_joints(got["simcc_x"], got["simcc_y"], (self.width, self.height))
        maps = got[self.output]
        cells = np.array(maps.shape[:1:-1])  # w, h
        places, scores = peaks(maps)
        refine = quarter_offset if self.decode == "quarter" else dark_offset
        stride = (size - 1) / (cells - 1) if self.decode == "udp" else size / cells
        return (places + refine(maps, places)) * stride, scores
