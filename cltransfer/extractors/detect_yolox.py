"""The main person in each frame, by YOLOX (https://arxiv.org/abs/2107.08430)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal

import cv2
import numpy as np
import torch

from ..features import Features
from ..models.onnx import Network
from ..models.places import find_model
from ..registry import EXTRACTORS
from ._pixels import to_uint8

SIDE = 416  # of the square the network sees [px]
STRIDES = (8, 16, 32)
GREY = 114  # fills the square beyond the image
PERSON = 0  # class of COCO
SAME_PERSON = 0.5  # intersection over union of two boxes of one person


def letterbox(image: np.ndarray) -> tuple[np.ndarray, tuple[int, int]]:
    """Fit ``image`` (H, W, 3) uint8 into the top left of the network's square.

    Returns:
        The square, (SIDE, SIDE, 3) uint8, and the size (W, H) that the image has in it.
    """
    height, width = image.shape[:2]
    scale = SIDE / max(height, width)
    size = max(1, int(width * scale)), max(1, int(height * scale))
    square = np.full((SIDE, SIDE, 3), GREY, np.uint8)
    square[: size[1], : size[0]] = cv2.resize(image, size, interpolation=cv2.INTER_LINEAR)
    return square, size


def decode_grid(raw: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Person boxes of the raw grid (B, 3549, 85): centre offset, log size, objectness, 80 classes per cell.

    Returns:
        Boxes (B, 3549, 4) as x, y, width, height [px of the square], and scores (B, 3549) in [0, 1], 0 where a person
        is not the best class.
    """
    cells, strides = [], []
    for stride in STRIDES:
        count = SIDE // stride
        y, x = np.divmod(np.arange(count * count), count)
        cells.append(np.stack([x, y], axis=1))
        strides.append(np.full((count * count, 1), stride))
    cell, stride_px = np.concatenate(cells), np.concatenate(strides)
    center = (raw[..., :2] + cell) * stride_px
    size = np.exp(raw[..., 2:4]) * stride_px
    scores = np.where(raw[..., 5:].argmax(-1) == PERSON, raw[..., 4] * raw[..., 5 + PERSON], 0)
    return np.concatenate([center - size / 2, size], axis=-1), scores


def main_box(boxes: np.ndarray, scores: np.ndarray, min_score: float) -> np.ndarray:
    """The box of largest score times area among those sure enough; no suppression is needed for one box.

    Args:
        boxes: (B, P, 4) as x, y, width, height.
        scores: (B, P) in [0, 1].
        min_score: what a box needs to count.

    Returns:
        (B, 5) as x, y, width, height, score; NaN where no box is sure enough.
    """
    weight = np.where(scores >= min_score, scores * boxes[..., 2] * boxes[..., 3], -1.0)
    best = weight.argmax(axis=1)
    rows = np.arange(len(boxes))
    found = np.concatenate([boxes[rows, best], scores[rows, best, None]], axis=1)
    return np.where(weight[rows, best, None] > 0, found, np.nan)


def all_boxes(boxes: np.ndarray, scores: np.ndarray, min_score: float) -> np.ndarray:
    """The boxes that are sure enough and overlap no surer one by half.

    Args:
        boxes: (P, 4) as x, y, width, height.
        scores: (P,) in [0, 1].
        min_score: what a box needs to count.

    Returns:
        (Q, 5) as x, y, width, height, score, the surest first.
    """
    sure = np.flatnonzero(scores >= min_score)
    corners = boxes[sure].astype(np.float64).tolist()
    kept = cv2.dnn.NMSBoxes(corners, scores[sure].tolist(), min_score, SAME_PERSON) if len(sure) else []
    rows = sure[np.array(kept, dtype=int).reshape(-1)]
    return np.concatenate([boxes[rows], scores[rows, None]], axis=1)


@EXTRACTORS.register("detect_yolox")
@dataclass(frozen=True)
class DetectYolox:
    """Box of the main person: the one of largest score times area.

    Args:
        model: ONNX file, ``images`` (1, 3, 416, 416) BGR 0-255 -> ``output`` (1, 3549, 85), the raw grid.
        min_score: objectness times class score a person needs, in [0, 1]; that must be the best class.
    """

    requires: ClassVar[tuple[str, ...]] = ("image",)
    provides: ClassVar[tuple[str, ...]] = ("box",)
    family: ClassVar[Literal["image", "scene", "both"]] = "image"
    passes: ClassVar[int] = 1
    model: str = "yolox_nano.onnx"
    min_score: float = 0.3

    def __post_init__(self) -> None:
        if not 0 <= self.min_score <= 1:
            raise ValueError(f"min_score must be in [0, 1], got {self.min_score}")

    @cached_property
    def network(self) -> Network:
        """The detector."""
        path = find_model(self.model)
        return Network(path, {"images": (None, 3, SIDE, SIDE)}, {"output": (None, 3549, 85)})

    def __call__(self, now: Features, before: Features | None = None) -> Features:
        """``now`` with ``box``.

        Raises:
            ModelError: the network is missing or refused.
        """
        boxes, scores = self._look(now)
        found = main_box(boxes, scores, self.min_score)
        return replace(now, box=torch.from_numpy(found).float().to(now.require("image").device))

    def persons(self, now: Features) -> list[np.ndarray]:
        """Boxes of all persons of each frame, (P, 5) as x, y, width, height [px], score, the surest first.

        Raises:
            ModelError: the network is missing or refused.
        """
        return [all_boxes(*frame, self.min_score) for frame in zip(*self._look(now))]

    def _look(self, now: Features) -> tuple[np.ndarray, np.ndarray]:
        """Boxes (B, P, 4) [px of the features' size] and scores (B, P)."""
        image = now.require("image")
        squares, sizes = zip(*(letterbox(frame) for frame in to_uint8(image)))
        bgr = np.stack(squares)[..., ::-1].transpose(0, 3, 1, 2).astype(np.float32)
        boxes, scores = decode_grid(self.network({"images": bgr})["output"])
        scale = np.array(now.size) / np.array(sizes)  # (B, 2)
        return boxes * np.tile(scale, 2)[:, None], scores
