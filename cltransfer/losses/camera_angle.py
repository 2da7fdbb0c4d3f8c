"""Camera angle: from where the camera looks at the person (paper Sec. 4.2.5)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

from torch import Tensor

from ..features import Features, check_pair
from ..orientation import wrap
from ..registry import LOSSES


def camera_angle_loss(reference: Tensor, rendered: Tensor, wrapped: bool = False) -> Tensor:
    """Sum of the differences of yaw, pitch and roll (paper Eq. 13-14).

    Args:
        reference: yaw, pitch, roll, (R, 3) [rad], R = 1 or B.
        rendered: the same of B candidates, (B, 3) [rad].
        wrapped: take each difference the short way round. The paper does not: 179 against -179 degrees costs 358.

    Returns:
        (B,) [rad], >= 0; NaN where an angle is undefined.
    """
    difference = rendered - reference  # Eq. 13
    return (wrap(difference) if wrapped else difference).abs().sum(-1)  # Eq. 14


@LOSSES.register("camera_angle")
@dataclass(frozen=True)
class CameraAngle:
    """Sum of the differences of yaw, pitch and roll of the camera about the person (paper Eq. 13-14).

    Args:
        mode: ``robust`` takes each difference the short way round, ``faithful`` does not wrap. Yaw is 0 in front of the
            person and runs to a half turn either way, so that the seam lies at the back; it lies at the face where an
            azimuth runs from 0 to 360 degrees, which the paper does not say of its own.
        weight: lambda of Eq. 15; tolerance 0.05 rad.

    The penalty is 3 pi: every angle as wrong as it can be. Faithful: 5 pi, yaw and roll by a whole turn each.
    """

    mode: Literal["robust", "faithful"] = "robust"
    weight: float = 4.0

    requires: ClassVar[tuple[str, ...]] = ("orientation",)
    unit: ClassVar[str] = "rad"
    penalty: ClassVar[float] = 3 * math.pi
    groups: ClassVar[tuple[int, ...]] = (0, 1, 2)

    def __post_init__(self) -> None:
        if self.mode == "faithful":
            object.__setattr__(self, "penalty", 5 * math.pi)

    def residuals(self, reference: Features, rendered: Features) -> Tensor:
        """Signed differences of yaw, pitch and roll, (B, 3)."""
        check_pair(reference, rendered)
        difference = rendered.require("orientation") - reference.require("orientation")
        return wrap(difference) if self.mode == "robust" else difference

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        """Raw loss, (B,) [rad]; NaN where undefined."""
        check_pair(reference, rendered)
        angles = reference.require("orientation"), rendered.require("orientation")
        return camera_angle_loss(*angles, wrapped=self.mode == "robust")
