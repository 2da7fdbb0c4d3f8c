"""Optical flow by RAFT (https://arxiv.org/abs/2003.12039)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import interpolate

from ..errors import ModelError
from ..features import Features
from ..models.onnx import Network
from ..models.places import find_model
from ..registry import EXTRACTORS
from ._flow_check import round_trip_confidence
from ._pixels import MOST, require_input, resized, to_uint8

STRIDE = 8  # the network's input has sides that are multiples of it
SMALLEST = 128  # side below which its coarsest correlation has no room [px]


@EXTRACTORS.register("flow_raft")
@dataclass(frozen=True)
class FlowRaft:
    """Backward flow i -> i-1 of what is seen, on the pixels of ``image`` (paper Sec. 9).

    Args:
        model: ONNX file, ``image1`` and ``image2`` (1 or B, 3, h, w) RGB 0-255 -> the flow from the first to the
            second, (1 or B, 2, h, w) as x, y [px].
        height: rows it is computed at [px]; a frame with fewer keeps its own. The vectors are in pixels of the
            features' size whatever this is.
        width: columns, for a network of one fixed size, which ``height`` then is too; by default the frame's
            aspect is kept.
        check: compute it the other way round too, and provide ``flow_confidence``; takes twice the time.
        output: name of the flow.
    """

    requires: ClassVar[tuple[str, ...]] = ("image",)
    provides: ClassVar[tuple[str, ...]] = ("flow", "flow_confidence")
    family: ClassVar[Literal["image", "scene", "both"]] = "image"
    needs_before: ClassVar[bool] = True
    model: str
    height: int = 432
    width: int | None = None
    check: bool = True
    output: str = "flow"

    def __post_init__(self) -> None:
        if not all(SMALLEST <= side <= MOST for side in (self.height, self.width) if side is not None):
            raise ValueError(f"height and width must be {SMALLEST} to {MOST}, got {self.height} and {self.width}")
        if not self.check:
            object.__setattr__(self, "provides", ("flow",))

    @property
    def passes(self) -> int:
        """Network passes one frame costs."""
        return 2 if self.check else 1

    @cached_property
    def network(self) -> Network:
        """The flow network."""
        shape = (None, 3, None, None)
        return Network(find_model(self.model), {"image1": shape, "image2": shape}, {self.output: (None, 2, None, None)})

    def __call__(self, now: Features, before: Features | None) -> Features:
        """``now`` with ``flow`` and, where checked, its confidence; NaN without a frame before.

        Raises:
            ModelError: the network is missing or refused.
        """
        image = now.require("image")
        count, _, height, width = image.shape
        flow = torch.full((count, 2, height, width), torch.nan)
        confidence = torch.full((count, height, width), torch.nan)
        if before is not None:
            size = self._size(width, height)
            require_input(self.model, 2 * count, size, "make its height smaller, or crop what is so long")
            new, old = padded(image, size), padded(before.require("image"), size)
            old = np.repeat(old, count // len(old), axis=0)
            backward = self._flow(new, old, size)
            scale = torch.tensor([now.size[0] / size[0], now.size[1] / size[1]])[:, None, None]
            flow = interpolate(backward * scale, (height, width), mode="bilinear")
            if self.check:
                trust = round_trip_confidence(backward, self._flow(old, new, size))
                confidence = interpolate(trust[:, None], (height, width), mode="bilinear")[:, 0]
        found = replace(now, flow=flow.to(image.device))
        return replace(found, flow_confidence=confidence.to(image.device)) if self.check else found

    def _flow(self, first: np.ndarray, second: np.ndarray, size: tuple[int, int]) -> Tensor:
        """Flow (B, 2, h, w) [px] of padded frames, without the padding."""
        wide = self.network({"image1": first, "image2": second})[self.output]
        if wide.shape[2:] != first.shape[2:]:
            reason = f"expected the input's {first.shape[2:]}, got {wide.shape[2:]}"
            raise ModelError(self.model, f"output {self.output}", reason, "is it the flow at an eighth of the size?")
        left, top = ((-side % STRIDE) // 2 for side in size)
        return torch.from_numpy(wide[:, :, top : top + size[1], left : left + size[0]])

    def _size(self, width: int, height: int) -> tuple[int, int]:
        """What frames of ``width`` by ``height`` are resized to (W, H) [px]."""
        if self.width is not None:
            return self.width, self.height
        scale = max(min(1.0, self.height / height), SMALLEST / min(width, height))
        return round(width * scale), round(height * scale)


def padded(image: Tensor, size: tuple[int, int]) -> np.ndarray:
    """RGB 0-255 (B, 3, h, w) float32 of ``image`` (B, 3, H, W) in [0, 1] at ``size`` (W, H).

    Both sides are filled up to multiples of 8 with the edge's pixels, half on each side.
    """
    small = resized(to_uint8(image), size)
    (left, right), (top, below) = ((more // 2, more - more // 2) for more in (-side % STRIDE for side in size))
    wide = np.pad(small, ((0, 0), (top, below), (left, right), (0, 0)), mode="edge")
    return wide.transpose(0, 3, 1, 2).astype(np.float32)
