"""The person's pixels by MediaPipe's selfie segmentation (landscape model)."""

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
from ._pixels import resized, to_uint8

SIZE = (256, 144)  # of the network's input (W, H) [px]


@EXTRACTORS.register("segment_selfie")
@dataclass(frozen=True)
class SegmentSelfie:
    """Pixels of whoever is near the camera; of several persons it takes all, and of a far one none.

    Args:
        model: ONNX file, ``input`` (1, 3, 144, 256) RGB in [0, 1], the frame stretched -> ``output``
            (1, 1, 144, 256), the probability of a person.
        threshold: probability above which a pixel is the person's, in (0, 1).
    """

    requires: ClassVar[tuple[str, ...]] = ("image",)
    provides: ClassVar[tuple[str, ...]] = ("subject",)
    family: ClassVar[Literal["image", "scene", "both"]] = "image"
    passes: ClassVar[int] = 1
    model: str = "mp_selfie_segmentation_landscape.onnx"
    threshold: float = 0.5

    def __post_init__(self) -> None:
        if not 0 < self.threshold < 1:
            raise ValueError(f"threshold must be in (0, 1), got {self.threshold}")

    @cached_property
    def network(self) -> Network:
        """The segmenter."""
        shape = (None, 3, SIZE[1], SIZE[0])
        return Network(find_model(self.model), {"input": shape}, {"output": (None, 1, SIZE[1], SIZE[0])})

    def __call__(self, now: Features, before: Features | None = None) -> Features:
        """``now`` with ``subject``, on the pixels of ``image``.

        Raises:
            ModelError: the network is missing or refused.
        """
        image = now.require("image")
        height, width = image.shape[2:]
        small = resized(to_uint8(image), SIZE, cv2.INTER_AREA)
        got = self.network({"input": small.transpose(0, 3, 1, 2).astype(np.float32) / 255})["output"][:, 0]
        maps = np.stack([cv2.resize(one, (width, height), interpolation=cv2.INTER_LINEAR) for one in got])
        return replace(now, subject=torch.from_numpy(maps > self.threshold).to(image.device))
