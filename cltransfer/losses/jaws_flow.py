"""Flow matching as in JAWS: the whole frame's flow, pixel by pixel; a baseline for :mod:`.camera_movement`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor
from torch.nn.functional import interpolate

from ..features import Features, check_pair
from ..registry import LOSSES

SIDE = 224  # [px] of the frames that JAWS reads: squashed to a square, whatever their shape


def flow_error(reference: Tensor, rendered: Tensor) -> Tensor:
    """Mean over pixels and both components of the squared difference, ``EE`` in JAWS.

    Args:
        reference: (R, 2, H, W), R = 1 or B.
        rendered: (B, 2, H, W).

    Returns:
        (B,), >= 0; pixels that lack either flow (NaN) are left out, NaN where none is left.
    """
    difference = rendered - reference
    known = ~difference.isnan()
    return _mean_of(difference.where(known, 0.0).square(), known)  # masked before: 0 * NaN is no gradient


def flow_angle(reference: Tensor, rendered: Tensor) -> Tensor:
    """Mean angle between (u, v, 1) of both flows, in half turns, ``AN`` in JAWS; the 1 gives no motion an angle too.

    Args are those of :func:`flow_error`; (B,) in [0, 1], NaN where no pixel has both flows.
    """
    known = ~(reference + rendered).isnan().any(1, keepdim=True)
    (u, v), (s, t) = (flow.where(known, 0.0).unbind(1) for flow in (reference, rendered))
    square = (v - t).square() + (s - u).square() + (u * t - v * s).square()  # of (u, v, 1) x (s, t, 1)
    sine = square.where(square > 0, 1.0).sqrt().where(square > 0, 0.0)  # masked before: the root of 0 has no gradient
    angle = torch.atan2(sine, u * s + v * t + 1)
    return _mean_of(angle / torch.pi, known[:, 0])


def _mean_of(values: Tensor, known: Tensor) -> Tensor:
    """Mean of each row of ``values`` over what is ``known``, of the same shape; NaN of nothing."""
    return values.where(known, 0.0).flatten(1).sum(1) / known.flatten(1).sum(1)


@LOSSES.register("jaws_flow")
@dataclass(frozen=True)
class JawsFlow:
    """Squared difference of the flow and, beside it, its angle: JAWS' inter-frame loss, for comparison.

    JAWS takes the flow forwards; here both sides have it backwards (i -> i-1), which turns every vector about.
    Undefined on the first frame, which has no flow.

    Args:
        quirks: vectors are those of frames squashed to 224 x 224 and not scaled back, as in the published code;
            otherwise they are in pixels of a frame 224 high.
        angular: weight of the angle, >= 0; 0 leaves it out.
        weight: of the term; JAWS: 0.7.

    The penalty is that of a quarter of the width of a frame of 2.4:1 in one frame, a whip pan; a squared difference, as
    published, has no bound.
    """

    quirks: bool = False
    angular: float = 1.0
    weight: float = 0.7

    requires: ClassVar[tuple[str, ...]] = ("flow",)
    unit: ClassVar[str] = "px^2 at 224"
    penalty: ClassVar[float] = 0.5 * (2.4 * SIDE / 4) ** 2

    def __post_init__(self) -> None:
        if self.angular < 0:
            raise ValueError(f"angular must be >= 0, got {self.angular}")

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        """Raw loss, (B,) [px^2 at 224, and half turns]; NaN where undefined."""
        check_pair(reference, rendered)
        found, wanted = self._vectors(rendered), self._vectors(reference)
        dtype = torch.promote_types(found.dtype, wanted.dtype)
        found = found.to(dtype)
        wanted = interpolate(wanted.to(dtype), tuple(found.shape[-2:]), mode="nearest-exact")
        error = flow_error(wanted, found)
        return error + self.angular * flow_angle(wanted, found) if self.angular else error

    def _vectors(self, features: Features) -> Tensor:
        """Flow (B, 2, H, W) in pixels of a frame of 224."""
        flow = features.require("flow")
        flow = flow.to(torch.promote_types(flow.dtype, torch.float32))  # scaled by parts of a pixel
        width, height = features.size
        per_pixel = flow.new_tensor([SIDE / width if self.quirks else SIDE / height, SIDE / height])
        return flow * per_pixel[:, None, None]
