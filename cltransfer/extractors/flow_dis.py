"""Optical flow by dense inverse search (https://arxiv.org/abs/1603.03590)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import cv2
import numpy as np
import torch

from ..features import Features
from ..pixels import to_uint8
from ..registry import EXTRACTORS

PRESETS = {
    "ultrafast": cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST,
    "fast": cv2.DISOPTICAL_FLOW_PRESET_FAST,
    "medium": cv2.DISOPTICAL_FLOW_PRESET_MEDIUM,
}
SMALLEST = 24  # side below which the search has no room [px]


@EXTRACTORS.register("flow_dis")
@dataclass(frozen=True)
class FlowDis:
    """Backward flow i -> i-1 of what is seen, on the pixels of ``image``.

    Args:
        preset: how thorough the search is.
        height: rows it is computed at [px]; a frame with fewer keeps its own. The vectors are in pixels of the
            features' size whatever this is.
    """

    requires: ClassVar[tuple[str, ...]] = ("image",)
    provides: ClassVar[tuple[str, ...]] = ("flow",)
    family: ClassVar[Literal["image", "scene", "both"]] = "image"
    needs_before: ClassVar[bool] = True
    preset: Literal["ultrafast", "fast", "medium"] = "medium"
    height: int = 360

    def __post_init__(self) -> None:
        if self.height < SMALLEST:
            raise ValueError(f"height must be at least {SMALLEST}, got {self.height}")

    def __call__(self, now: Features, before: Features | None) -> Features:
        """``now`` with ``flow``; NaN without a frame before."""
        image = now.require("image")
        count, _, height, width = image.shape
        flow = torch.full((count, 2, height, width), torch.nan)
        if before is not None:
            then = before.require("image").expand(count, -1, -1, -1)
            search = cv2.DISOpticalFlow.create(PRESETS[self.preset])
            for i, pair in enumerate(zip(self._grey(image), self._grey(then))):  # one call takes one pair
                small = search.calc(*pair, None)  # type: ignore[call-overload]  # None: no first guess
                scale = np.array([now.size[0] / small.shape[1], now.size[1] / small.shape[0]], np.float32)
                full = cv2.resize(small * scale, (width, height), interpolation=cv2.INTER_LINEAR)
                flow[i] = torch.from_numpy(full).permute(2, 0, 1)
        return replace(now, flow=flow.to(image.device))

    def _grey(self, image: torch.Tensor) -> list[np.ndarray]:
        height, width = image.shape[2:]
        rows = min(height, self.height)
        size = (max(SMALLEST, round(width * rows / height)), max(SMALLEST, rows))
        grey = (cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY) for frame in to_uint8(image))
        return [cv2.resize(frame, size, interpolation=cv2.INTER_AREA) for frame in grey]
