"""Optical flow by a variational method with large displacements: DeepFlow (https://doi.org/10.1109/ICCV.2013.175)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import cv2
from numpy.typing import NDArray

from ..features import Features
from ..registry import EXTRACTORS
from ._dense_flow import check_height, with_flow


@EXTRACTORS.register("flow_deep")
@dataclass(frozen=True)
class FlowDeep:
    """Backward flow i -> i-1 on the pixels of ``image``, slower and finer than ``flow_dis``: for a reference.

    OpenCV's version of DeepFlow: its variational part, coarse to fine, without the matching of descriptors.

    Args:
        height: rows it is computed at [px]; a frame with fewer keeps its own. The vectors are in pixels of the
            features' size whatever this is.
        check: compute it the other way round too, and provide ``flow_confidence``; takes twice the time.
    """

    requires: ClassVar[tuple[str, ...]] = ("image",)
    provides: ClassVar[tuple[str, ...]] = ("flow", "flow_confidence")
    family: ClassVar[Literal["image", "scene", "both"]] = "image"
    needs_before: ClassVar[bool] = True
    height: int = 180
    check: bool = True

    def __post_init__(self) -> None:
        check_height(self.height)
        if not self.check:
            object.__setattr__(self, "provides", ("flow",))

    def __call__(self, now: Features, before: Features | None) -> Features:
        """``now`` with ``flow`` and, where checked, its confidence; NaN without a frame before."""

        def pair_flow(first: NDArray, second: NDArray) -> NDArray:
            method = cv2.optflow.createOptFlow_DeepFlow()  # one holds a pair
            return method.calc(first, second, None)  # type: ignore[call-overload]  # None: no first guess

        return with_flow(now, before, pair_flow, self.height, self.check)
