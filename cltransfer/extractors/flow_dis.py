"""Optical flow by dense inverse search (https://arxiv.org/abs/1603.03590)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

import cv2
from numpy.typing import NDArray

from ..features import Features
from ..registry import EXTRACTORS
from ._dense_flow import check_height, with_flow

PRESETS = {
    "ultrafast": cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST,
    "fast": cv2.DISOPTICAL_FLOW_PRESET_FAST,
    "medium": cv2.DISOPTICAL_FLOW_PRESET_MEDIUM,
}


@EXTRACTORS.register("flow_dis")
@dataclass(frozen=True)
class FlowDis:
    """Backward flow i -> i-1 of what is seen, on the pixels of ``image``.

    Args:
        preset: how thorough the search is.
        height: rows it is computed at [px]; a frame with fewer keeps its own. The vectors are in pixels of the
            features' size whatever this is.
        check: search the other way round too, and provide ``flow_confidence``; takes twice the time.
    """

    requires: ClassVar[tuple[str, ...]] = ("image",)
    provides: ClassVar[tuple[str, ...]] = ("flow", "flow_confidence")
    family: ClassVar[Literal["image", "scene", "both"]] = "image"
    needs_before: ClassVar[bool] = True
    preset: Literal["ultrafast", "fast", "medium"] = "medium"
    height: int = 360
    check: bool = True

    def __post_init__(self) -> None:
        check_height(self.height)
        if not self.check:
            object.__setattr__(self, "provides", ("flow",))

    def __call__(self, now: Features, before: Features | None) -> Features:
        """``now`` with ``flow`` and, where checked, its confidence; NaN without a frame before."""

        def pair_flow(first: NDArray, second: NDArray) -> NDArray:
            search = cv2.DISOpticalFlow.create(PRESETS[self.preset])  # one holds a pair
            search.setFinestScale(min(search.getFinestScale(), _coarsest(first.shape, search.getPatchSize())))
            return search.calc(first, second, None)  # type: ignore[call-overload]  # None: no first guess

        return with_flow(now, before, pair_flow, self.height, self.check)


def _coarsest(shape: tuple[int, ...], patch: int) -> int:
    """How often OpenCV may halve a frame of this ``shape``, so that patches of ``patch`` [px] have room.

    A preset that begins below finds no level, and OpenCV chooses one by the width alone: it fails in wide, low frames.
    """
    longer, shorter = max(shape), min(shape)
    return max(0, min(int(math.log2(longer / (4 * patch)) + 0.5), int(math.log2(shorter / patch))))
