"""The main person's box and pixels by YOLOv8-seg or YOLO11-seg (https://docs.ultralytics.com)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal

import cv2
import numpy as np
import torch

from ..errors import ModelError
from ..features import Features
from ..models.onnx import Network
from ..models.places import find_model
from ..registry import EXTRACTORS
from ._pixels import to_uint8

GREY = 114  # fills the square beyond the image
PERSON = 0  # class of COCO
PROTOTYPES = 32
STRIDES = (8, 16, 32)


@dataclass(frozen=True)
class Letterbox:
    """Where an image of ``image`` (W, H) [px] lies in the middle of a square of ``side`` [px]."""

    side: int
    image: tuple[int, int]

    @property
    def size(self) -> tuple[int, int]:
        """What the image takes (W, H) [px of the square]."""
        scale = self.side / max(self.image)
        return max(1, round(self.image[0] * scale)), max(1, round(self.image[1] * scale))

    @property
    def corner(self) -> tuple[int, int]:
        """Its top left corner (x, y) [px of the square]; an odd rest goes to the right and below."""
        return (self.side - self.size[0]) // 2, (self.side - self.size[1]) // 2

    def fit(self, image: np.ndarray) -> np.ndarray:
        """The square (side, side, 3) uint8 of the image (H, W, 3) uint8."""
        (x, y), (width, height) = self.corner, self.size
        square = np.full((self.side, self.side, 3), GREY, np.uint8)
        square[y : y + height, x : x + width] = cv2.resize(image, self.size, interpolation=cv2.INTER_LINEAR)
        return square

    def to_image(self, boxes: np.ndarray) -> np.ndarray:
        """Boxes (..., 4) as x, y, width, height [px of the square] in pixels of the image."""
        scale = np.array(self.image) / np.array(self.size)
        return np.concatenate([(boxes[..., :2] - self.corner) * scale, boxes[..., 2:] * scale], axis=-1)

    def spread(self, values: np.ndarray) -> np.ndarray:
        """A map (h, w) float32 over the square as seen on the image's pixels, (H, W)."""
        cells = np.array(values.shape[::-1]) / self.side  # of the map in a pixel of the square
        scale = cells * self.size / self.image
        shift = cells * self.corner + scale / 2 - 0.5  # OpenCV's pixels have their centre at 0
        matrix = np.array([[scale[0], 0, shift[0]], [0, scale[1], shift[1]]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        return cv2.warpAffine(values, matrix, self.image, flags=flags, borderMode=cv2.BORDER_REPLICATE)


def main_person(raw: np.ndarray, min_score: float, max_overlap: float) -> int | None:
    """Column of ``raw`` (4 + classes + 32, P) that shows the main person, None if there is none.

    A column is a person where that is its best class. Of those that overlap by more than ``max_overlap`` (IoU)
    the surest stays, and of those that stay the one of largest score times area is meant.
    """
    classes = raw[4:-PROTOTYPES]
    columns = np.flatnonzero((classes.argmax(0) == PERSON) & (classes[PERSON] >= min_score))
    if not len(columns):
        return None
    center, size = raw[:2, columns].T, raw[2:4, columns].T
    scores = classes[PERSON, columns]
    boxes = np.concatenate([center - size / 2, size], axis=1)
    kept = cv2.dnn.NMSBoxes(boxes.tolist(), scores.tolist(), 0.0, max_overlap)
    if not len(kept):  # of scores that are all 0 none is
        return None
    weight = scores[kept] * size[kept].prod(axis=1)
    return int(columns[kept[weight.argmax()]])


@EXTRACTORS.register("segment_yolo")
@dataclass(frozen=True)
class SegmentYolo:
    """Box and pixels of the main person (the paper's character layer, Sec. 9); NaN and none without one.

    Args:
        model: ONNX file, ``images`` (1 or B, 3, side, side) RGB in [0, 1], letterboxed -> ``output0``
            (1 or B, 4 + classes + 32, P): centre, size, class scores, mask coefficients; ``output1``
            (1 or B, 32, h, w): mask prototypes.
        side: of the square the network sees [px].
        min_score: what a person needs, in [0, 1].
        max_overlap: intersection over union above which the less sure of two boxes is dropped, in [0, 1].
    """

    requires: ClassVar[tuple[str, ...]] = ("image",)
    provides: ClassVar[tuple[str, ...]] = ("box", "subject")
    family: ClassVar[Literal["image", "scene", "both"]] = "image"
    passes: ClassVar[int] = 1
    model: str
    side: int = 640
    min_score: float = 0.25
    max_overlap: float = 0.7

    def __post_init__(self) -> None:
        if self.side < 32 or self.side % 32:
            raise ValueError(f"side must be a positive multiple of 32, got {self.side}")
        if not (0 <= self.min_score <= 1 and 0 <= self.max_overlap <= 1):
            raise ValueError("min_score and max_overlap must be in [0, 1]")

    @cached_property
    def network(self) -> Network:
        """The segmenter."""
        outputs = {"output0": (None, None, None), "output1": (None, PROTOTYPES, None, None)}
        return Network(find_model(self.model), {"images": (None, 3, self.side, self.side)}, outputs)

    def __call__(self, now: Features, before: Features | None = None) -> Features:
        """``now`` with ``box`` and ``subject``.

        Raises:
            ModelError: the network is missing or refused.
        """
        image = now.require("image")
        count, _, height, width = image.shape
        frame = Letterbox(self.side, (width, height))
        squares = np.stack([frame.fit(one) for one in to_uint8(image)])
        got = self.network({"images": squares.transpose(0, 3, 1, 2).astype(np.float32) / 255})
        self._check_layout(got["output0"].shape)
        box, subject = torch.full((count, 5), torch.nan), torch.zeros((count, height, width), dtype=torch.bool)
        scale = np.array([now.size[0] / width, now.size[1] / height, 1.0])
        for i, raw in enumerate(got["output0"]):  # 2.5 ms a frame of 1280x720 and 8,400 boxes
            column = main_person(raw, self.min_score, self.max_overlap)
            if column is None:
                continue
            center, extent = raw[:2, column], raw[2:4, column]
            found = frame.to_image(np.concatenate([center - extent / 2, extent]))
            logits = np.tensordot(raw[-PROTOTYPES:, column], got["output1"][i], 1)
            subject[i] = torch.from_numpy((frame.spread(logits) > 0) & _inside(found, (width, height)))
            box[i] = torch.from_numpy(np.append(found, raw[4 + PERSON, column]) * scale[[0, 1, 0, 1, 2]])
        return replace(now, box=box.to(image.device), subject=subject.to(image.device))

    def _check_layout(self, shape: tuple[int, ...]) -> None:
        """Refuse what is no raw grid: detections after NMS, columns and rows swapped, no classes."""
        cells = sum((self.side // stride) ** 2 for stride in STRIDES)
        if shape[1] <= 4 + PROTOTYPES or shape[2] != cells:
            reason = f"expected (B, 4 + classes + {PROTOTYPES}, {cells}), got {shape}"
            raise ModelError(self.model, "output output0", reason, "export it with nms=False end2end=False")


def _inside(box: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Pixels (H, W) of an image of ``size`` whose centre is in ``box`` as x, y, width, height."""
    x, y = np.arange(size[0]) + 0.5, np.arange(size[1])[:, None] + 0.5
    return (x >= box[0]) & (x < box[0] + box[2]) & (y >= box[1]) & (y < box[1] + box[3])
