"""An example plugin: keep the person where the reference keeps them among the thirds of the frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from cltransfer import LOSSES, Features


def distance_to_thirds(centroid: Tensor) -> Tensor:
    """Distance (B,) of points (B, 2), x/W and y/H, to the nearest of the four crossings of the thirds."""
    third = torch.where(centroid < 0.5, 1 / 3, 2 / 3).to(centroid)
    return (centroid - third).norm(dim=-1)


def centroid(features: Features, min_confidence: float) -> Tensor:
    """Mean place (B, 2) of the joints seen, x/W and y/H; NaN where none is."""
    keypoints = features.require("keypoints")
    seen = keypoints[..., 2:] > min_confidence
    total = keypoints[..., :2].masked_fill(~seen, 0).sum(1) / seen.sum(1)
    return total / total.new_tensor(features.size)


@LOSSES.register("rule_of_thirds")
@dataclass(frozen=True)
class RuleOfThirds:
    """Difference of the person's distance to the nearest crossing of the thirds.

    Unlike framing it does not ask for the same crossing: a person on the left third matches one on the right.

    Args:
        min_confidence: joints above it count as seen, in [0, 1).
        weight: lambda of the total; tolerance 0.02 of the frame.

    The penalty is the frame's diagonal, 2 ** 0.5.
    """

    min_confidence: float = 0.5
    weight: float = 10.0

    requires: ClassVar[tuple[str, ...]] = ("keypoints",)
    unit: ClassVar[str] = "frame"
    penalty: ClassVar[float] = 2**0.5
    groups: ClassVar[tuple[int, ...]] = (0,)

    def __post_init__(self) -> None:
        if not 0 <= self.min_confidence < 1:
            raise ValueError(f"min_confidence must be in [0, 1), got {self.min_confidence}")

    def residuals(self, reference: Features, rendered: Features) -> Tensor:
        """Signed difference, (B, 1) [frame]; NaN where either side shows no joint."""
        distances = [distance_to_thirds(centroid(f, self.min_confidence)) for f in (reference, rendered)]
        return (distances[1] - distances[0])[:, None]

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        """Raw loss, (B,) [frame]; NaN where either side shows no joint."""
        return self.residuals(reference, rendered)[:, 0].abs()
