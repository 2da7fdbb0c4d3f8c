"""From which side the camera sees the subject, by Orient Anything (https://arxiv.org/abs/2412.18605)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np
import torch
from torch import Tensor

from ..errors import ModelError
from ..feature_shapes import on_grid
from ..features import Features
from ..models.onnx import Network
from ..models.places import find_model
from ..registry import EXTRACTORS
from ._crops import about_boxes
from ._pixels import normalised, to_uint8

SIDE = 224  # of the square the network sees [px]
MARGIN = SIDE / (256 * 0.85)  # the subject fills 0.85 of a square of 256 px, of which the middle is seen
AZIMUTHS, POLARS = 360, 180  # bins of one degree
WIDTHS = (722, 902)  # with 180 or 360 bins of rotation, and two of confidence


def read_bins(logits: Tensor) -> tuple[Tensor, Tensor]:
    """Orientation and confidence of the network's answer.

    The network gives azimuth in [0, 360) degrees, 0 in front of the subject and growing to the subject's left;
    the camera's elevation in [-90, 90); and the rotation of the image, counter-clockwise, about 0.

    Args:
        logits: (N, 722) or (N, 902): 360 azimuths, 180 elevations, 180 or 360 rotations, sure, unsure.

    Returns:
        Yaw, pitch, roll (N, 3) [rad] as in :class:`cltransfer.features.Features`, and the confidence (N,) in [0, 1].
    """
    azimuth = logits[:, :AZIMUTHS].argmax(1)
    elevation = logits[:, AZIMUTHS : AZIMUTHS + POLARS].argmax(1) - POLARS // 2
    turns = logits[:, AZIMUTHS + POLARS : -2]
    rotation = turns.argmax(1) - turns.shape[1] // 2
    yaw = torch.where(azimuth > 180, azimuth - 360, azimuth)
    degrees = torch.stack([yaw, elevation, -rotation], dim=1)  # our roll grows clockwise
    return torch.deg2rad(degrees.float()), logits[:, -2:].softmax(1)[:, 0]


def mask_boxes(masks: np.ndarray) -> np.ndarray:
    """Boxes (N, 4) as x, y, width, height [px] about the true pixels of ``masks`` (N, H, W); NaN for an empty one."""
    boxes = np.full((len(masks), 4), np.nan)
    for box, mask in zip(boxes, masks):
        columns, rows = np.flatnonzero(mask.any(0)), np.flatnonzero(mask.any(1))
        if len(rows):
            box[:] = columns[0], rows[0], columns[-1] + 1 - columns[0], rows[-1] + 1 - rows[0]
    return boxes


@EXTRACTORS.register("orient_anything")
@dataclass(frozen=True)
class OrientAnything:
    """Orientation of the subject cut out of the frame (paper Sec. 9); NaN without a subject or when unsure.

    Args:
        model: ONNX file, RGB (1 or B, 3, 224, 224) normalised as ImageNet -> logits (1 or B, 722 or 902).
        min_confidence: below it the orientation is NaN, in [0, 1].
        remove_background: paint what is not the subject black, as the authors do.
        input: name of the input.
        output: name of the logits.
    """

    requires: ClassVar[tuple[str, ...]] = ("image", "subject")
    provides: ClassVar[tuple[str, ...]] = ("orientation",)
    family: ClassVar[Literal["image", "scene", "both"]] = "image"
    passes: ClassVar[int] = 1
    model: str
    min_confidence: float = 0.5
    remove_background: bool = True
    input: str = "pixel_values"
    output: str = "logits"

    def __post_init__(self) -> None:
        if not 0 <= self.min_confidence <= 1:
            raise ValueError(f"min_confidence must be in [0, 1], got {self.min_confidence}")

    @cached_property
    def network(self) -> Network:
        """The orientation network."""
        return Network(find_model(self.model), {self.input: (None, 3, SIDE, SIDE)}, {self.output: (None, None)})

    def __call__(self, now: Features, before: Features | None = None) -> Features:
        """``now`` with ``orientation``.

        Raises:
            ModelError: the network is missing or refused.
        """
        image, subject = now.require("image"), now.require("subject")
        masks = on_grid(subject, image.shape[2:]).cpu().numpy()  # a network's mask may have fewer pixels
        boxes = mask_boxes(masks)
        rows = np.flatnonzero(np.isfinite(boxes).all(axis=1))
        orientation = torch.full((len(image), 3), torch.nan)
        if len(rows):
            images = to_uint8(image[rows])
            if self.remove_background:
                images *= masks[rows, :, :, None]
            crops = about_boxes(boxes[rows], MARGIN, SIDE)
            logits = self.network({self.input: normalised(crops.cut(images, smooth=True))})[self.output]
            if logits.shape[1] not in WIDTHS:
                raise ModelError(
                    self.model, f"output {self.output}", f"expected 722 or 902 bins, got {logits.shape[1]}"
                )
            angles, confidence = read_bins(torch.from_numpy(logits))
            orientation[rows] = angles.masked_fill((confidence < self.min_confidence)[:, None], torch.nan)
        return replace(now, orientation=orientation.to(image.device))
