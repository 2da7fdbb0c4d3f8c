"""A person's box and pixels by YOLOv8-seg or YOLO11-seg (https://docs.ultralytics.com)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal

import cv2
import numpy as np
import torch
from torch import Tensor

from ..clips.persons import overlap
from ..errors import ModelError
from ..features import Features
from ..models.onnx import Network
from ..models.places import find_model
from ..registry import EXTRACTORS
from ._pixels import MOST, require_input, to_uint8
from .detect_yolox import GREY, PERSON, SAME_PERSON, STRIDES

PROTOTYPES = 32


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


def all_persons(raw: np.ndarray, min_score: float, max_overlap: float) -> np.ndarray:
    """Columns of ``raw`` (4 + classes + 32, P) that show a person each, the surest first.

    A column is a person where that is its best class. Of those that overlap by more than ``max_overlap`` (IoU)
    the surest stays.
    """
    classes = raw[4:-PROTOTYPES]
    columns = np.flatnonzero((classes.argmax(0) == PERSON) & (classes[PERSON] >= min_score))
    boxes = boxes_of(raw, columns)
    kept = cv2.dnn.NMSBoxes(boxes[:, :4].tolist(), boxes[:, 4].tolist(), 0.0, max_overlap) if len(columns) else []
    return columns[np.array(kept, dtype=int).reshape(-1)]  # of scores that are all 0 none is kept


def boxes_of(raw: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Boxes (Q, 5) of ``columns`` (Q,) of ``raw`` as x, y, width, height [px of the square], score as a person."""
    center, size = raw[:2, columns].T, raw[2:4, columns].T
    return np.concatenate([center - size / 2, size, raw[4 + PERSON, columns, None]], axis=1)


def main_person(raw: np.ndarray, min_score: float, max_overlap: float) -> int | None:
    """Of :func:`all_persons` the column of largest score times area, None if there is nobody."""
    columns = all_persons(raw, min_score, max_overlap)
    boxes = boxes_of(raw, columns)
    return int(columns[(boxes[:, 4] * boxes[:, 2:4].prod(axis=1)).argmax()]) if len(columns) else None


@EXTRACTORS.register("segment_yolo")
@dataclass(frozen=True)
class SegmentYolo:
    """Box and pixels of one person (the paper's character layer, Sec. 9); NaN and none without one.

    The main one of each frame, or the one in the box that is given: along a clip one is followed.

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
        if not 32 <= self.side <= MOST or self.side % 32:
            raise ValueError(f"side must be a multiple of 32 from 32 to {MOST}, got {self.side}")
        if not (0 <= self.min_score <= 1 and 0 <= self.max_overlap <= 1):
            raise ValueError("min_score and max_overlap must be in [0, 1]")

    @cached_property
    def network(self) -> Network:
        """The segmenter."""
        outputs = {"output0": (None, None, None), "output1": (None, PROTOTYPES, None, None)}
        return Network(find_model(self.model), {"images": (None, 3, self.side, self.side)}, outputs)

    def __call__(self, now: Features, before: Features | None = None) -> Features:
        """``now`` with ``box``, which stays where it is given, and ``subject``.

        Raises:
            ModelError: the network is missing or refused.
        """
        image, given = now.require("image"), now.box
        count, _, height, width = image.shape
        frame, raws, prototypes = self._look(image)
        box, subject = torch.full((count, 5), torch.nan), torch.zeros((count, height, width), dtype=torch.bool)
        for i, raw in enumerate(raws):  # 2.5 ms a frame of 1280x720 and 8,400 boxes
            if given is None:
                column = main_person(raw, self.min_score, self.max_overlap)
            else:
                column = self._person_in(given[i].double().cpu().numpy(), raw, frame, now.size)
            if column is None:
                continue
            own = boxes_of(raw, np.array([column]))
            logits = np.tensordot(raw[-PROTOTYPES:, column], prototypes[i], 1)
            inside = _inside(frame.to_image(own[0, :4]), (width, height))
            subject[i] = torch.from_numpy((frame.spread(logits) > 0) & inside)
            box[i] = torch.from_numpy(_placed(own, frame, now.size)[0])
        return replace(now, box=box.to(image.device) if given is None else given, subject=subject.to(image.device))

    def persons(self, now: Features) -> list[np.ndarray]:
        """Boxes of all persons of each frame, (P, 5) as x, y, width, height [px], score, the surest first.

        Raises:
            ModelError: the network is missing or refused.
        """
        frame, raws, _ = self._look(now.require("image"))
        found = [boxes_of(raw, all_persons(raw, self.min_score, self.max_overlap)) for raw in raws]
        return [_placed(boxes, frame, now.size) for boxes in found]

    def _look(self, image: Tensor) -> tuple[Letterbox, np.ndarray, np.ndarray]:
        """Where frames (B, 3, H, W) lie in the square, boxes (B, 4 + classes + 32, P), prototypes (B, 32, h, w)."""
        frame = Letterbox(self.side, (image.shape[3], image.shape[2]))
        require_input(self.model, len(image), (self.side, self.side), "make its side smaller")
        squares = np.stack([frame.fit(one) for one in to_uint8(image)])
        got = self.network({"images": squares.transpose(0, 3, 1, 2).astype(np.float32) / 255})
        self._check_layout(got["output0"].shape)
        return frame, got["output0"], got["output1"]

    def _person_in(self, box: np.ndarray, raw: np.ndarray, frame: Letterbox, size: tuple[int, int]) -> int | None:
        """Column of the person in a ``box`` (5,) [px of ``size``], None where there is none."""
        columns = all_persons(raw, self.min_score, self.max_overlap)
        if not len(columns) or not np.isfinite(box).all():
            return None
        shared = overlap(box[None], _placed(boxes_of(raw, columns), frame, size))[0]
        return int(columns[shared.argmax()]) if shared.max() >= SAME_PERSON else None

    def _check_layout(self, shape: tuple[int, ...]) -> None:
        """Refuse what is no raw grid: detections after NMS, columns and rows swapped, no classes."""
        cells = sum((self.side // stride) ** 2 for stride in STRIDES)
        if shape[1] <= 4 + PROTOTYPES or shape[2] != cells:
            reason = f"expected (B, 4 + classes + {PROTOTYPES}, {cells}), got {shape}"
            raise ModelError(self.model, "output output0", reason, "export it with nms=False end2end=False")


def _placed(boxes: np.ndarray, frame: Letterbox, size: tuple[int, int]) -> np.ndarray:
    """Boxes (Q, 5) [px of the square] in pixels of ``size`` (W, H)."""
    scale = np.array(size) / np.array(frame.image)
    return np.concatenate([frame.to_image(boxes[:, :4]) * np.tile(scale, 2), boxes[:, 4:]], axis=1)


def _inside(box: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Pixels (H, W) of an image of ``size`` whose centre is in ``box`` as x, y, width, height."""
    x, y = np.arange(size[0]) + 0.5, np.arange(size[1])[:, None] + 0.5
    return (x >= box[0]) & (x < box[0] + box[2]) & (y >= box[1]) & (y < box[1] + box[3])
