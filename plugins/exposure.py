"""An example plugin that reads pixels: keep the person as bright against what is behind them as the reference does.

It has two components: an extractor that adds a feature of its own, and a loss on that.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import torch
from torch import Tensor
from torch.nn.functional import interpolate

from cltransfer import EXTRACTORS, LOSSES, Features

LUMINANCE = (0.2126, 0.7152, 0.0722)  # of linear red, green and blue (Rec. 709)
MOST = 4.0  # [stops] between a person and the background; a silhouette or a spotlight has no more


def luminance(image: Tensor) -> Tensor:
    """Linear luminance (B, H, W) in [0, 1] of sRGB images (B, 3, H, W) in [0, 1]."""
    linear = torch.where(image <= 0.04045, image / 12.92, ((image + 0.055) / 1.055) ** 2.4)
    return (linear * image.new_tensor(LUMINANCE)[:, None, None]).sum(1)


def stops_between(light: Tensor, subject: Tensor, black: float) -> Tensor:
    """Mean luminance of the person over that of all else, (B,) [stops], in [-MOST, MOST].

    Args:
        light: linear luminance, (B, H, W).
        subject: the person's pixels, (B, H, W) bool.
        black: added to both means, so that a black background is no infinity.

    Returns:
        log2 of the ratio; NaN where nobody is seen, or nothing else is.
    """
    person, rest = (
        (light * mask).sum((1, 2)) / mask.sum((1, 2))  # 0 / 0 is NaN
        for mask in (subject, ~subject)
    )
    return ((person + black) / (rest + black)).log2().clamp(-MOST, MOST)


@EXTRACTORS.register("exposure")
@dataclass(frozen=True)
class ReadExposure:
    """Adds ``exposure``, (B,) [stops]: how much brighter the person is than all else; NaN where nobody is seen.

    Args:
        black: luminance of the darkest thing that counts, in (0, 1).
    """

    black: float = 0.01

    requires: ClassVar[tuple[str, ...]] = ("image", "subject")
    provides: ClassVar[tuple[str, ...]] = ("exposure",)
    family: ClassVar[Literal["image", "scene", "both"]] = "both"  # clips and renders alike are read by their pixels

    def __post_init__(self) -> None:
        if not 0 < self.black < 1:
            raise ValueError(f"black must be in (0, 1), got {self.black}")

    def __call__(self, now: Features, before: Features | None) -> Features:
        """``now`` with ``exposure`` among its extras."""
        image, subject = now.require("image"), now.require("subject")
        if subject.shape[1:] != image.shape[2:]:  # a network's mask may have fewer pixels
            subject = interpolate(subject[:, None].float(), image.shape[2:], mode="nearest-exact")[:, 0] > 0.5
        return now.having("exposure", stops_between(luminance(image), subject, self.black))


@LOSSES.register("exposure")
@dataclass(frozen=True)
class Exposure:
    """Squared difference of ``exposure``: a third of a stop is hardly seen, two stops are another picture.

    Args:
        weight: lambda of the total, 1 / (5 * tolerance); tolerance a third of a stop, squared.

    The penalty is that of a silhouette for a spotlight, so that leaving the frame never pays.
    """

    weight: float = 1.8

    requires: ClassVar[tuple[str, ...]] = ("exposure",)
    unit: ClassVar[str] = "stops^2"
    penalty: ClassVar[float] = (2 * MOST) ** 2
    groups: ClassVar[tuple[int, ...]] = (0,)

    def residuals(self, reference: Features, rendered: Features) -> Tensor:
        """The square with the sign of the difference, (B, 1) [stops^2]: so the search knows which side it is on."""
        difference = rendered.require("exposure") - reference.require("exposure")
        return (difference * difference.abs())[:, None]

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        """Raw loss, (B,) [stops^2]; NaN where either side shows nobody."""
        return self.residuals(reference, rendered)[:, 0].abs()
