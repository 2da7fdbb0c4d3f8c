"""Filmic space: how deep the frame feels (paper Sec. 4.2.3)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

import torch
from torch import Tensor

from ..feature_shapes import layers_on
from ..features import Features, check_pair
from ..registry import LOSSES
from ._depth_mode import depth_mode, nearest_peak


def log_depth_ratios(depths: Tensor) -> Tensor:
    """Logs of d_bc and d_fc (paper Eq. 9), (B, 2), of foreground, character, background depths (B, 3)."""
    empty = depths.isnan()  # whose logs have no gradient either
    foreground, character, background = depths.masked_fill(empty, 1.0).log().masked_fill(empty, torch.nan).unbind(-1)
    return torch.stack([background - character, foreground - character], dim=-1)


def filmic_space_loss(reference: Tensor, rendered: Tensor) -> Tensor:
    """Difference of the log depth ratios between layers (paper Eq. 8), skipping a ratio that a side lacks.

    Args:
        reference: representative depths of foreground, character, background, (R, 3), > 0, R = 1 or B, any
            unit; NaN where the layer is empty.
        rendered: the same of B candidates, (B, 3).

    Returns:
        (B,) dimensionless, >= 0; NaN where both ratios are skipped.

    >>> filmic_space_loss(torch.tensor([[1.0, 2.0, 4.0]]), torch.tensor([[2.0, 4.0, 8.0]]))
    tensor([0.])
    """
    return _skip(log_depth_ratios(rendered) - log_depth_ratios(reference)).abs().sum(-1)


def _skip(differences: Tensor) -> Tensor:
    missing = differences.isnan()
    return differences.masked_fill(missing & ~missing.all(-1, keepdim=True), 0)


def space_differences(reference: Tensor, rendered: Tensor, mismatch: float) -> Tensor:
    """Signed differences of the log depth ratios where an empty layer costs.

    Args:
        reference: as in :func:`filmic_space_loss`.
        rendered: as in :func:`filmic_space_loss`.
        mismatch: cost of a layer that one side has and the other lacks, >= 0. Where both lack it, it is 0.

    Returns:
        (B, 2) of background and foreground against the character; NaN where the character is missing.
    """
    differences = log_depth_ratios(rendered) - log_depth_ratios(reference)
    empty_reference, empty_rendered = reference[:, [2, 0]].isnan(), rendered[:, [2, 0]].isnan()
    differences = differences.masked_fill(empty_reference & empty_rendered, 0.0)
    differences = differences.masked_fill(empty_reference ^ empty_rendered, mismatch)
    return differences.masked_fill((reference[:, 1:2] + rendered[:, 1:2]).isnan(), float("nan"))


def layer_depths(features: Features, min_area: float) -> Tensor:
    """Representative depth of foreground, character, background, (B, 3); NaN where less than ``min_area`` has any."""
    layers, depth = layers_on(features, "depth"), features.require("depth")
    told = layers & (depth.isfinite() & (depth > 0))[:, None]
    small = told.flatten(2).float().mean(-1) < min_area
    return depth_mode(depth, layers).masked_fill(small, float("nan"))


def counted(losses: Mapping[str, object]) -> list[str]:
    """Losses that are filmic space, or a class of it, and weigh something: they tell a lens from distance."""
    return [name for name, loss in losses.items() if isinstance(loss, FilmicSpace) and loss.weight > 0]


@LOSSES.register("filmic_space")
@dataclass(frozen=True)
class FilmicSpace:
    """Difference of the log depth ratios background : character and foreground : character (paper Eq. 8-10).

    It does not change with the scale of either depth, and a lens changes it only by what it leaves out of the
    frame. It does change with a shift of inverse depth, which some depth networks leave unknown: use depth
    from the same source on both sides.

    Args:
        mode: ``faithful`` skips a ratio whose layer is empty on either side; ``robust`` lets it cost
            ``mismatch``, and counts one below ``min_area`` as empty. Both find the mode of Eq. 10 over log depth, where
            the paper has it over depth (:func:`cltransfer.losses._depth_mode.depth_mode` tells what that changes).
        mismatch: cost of a layer on one side only, >= 0 [log]; log 2 is a layer at twice the depth. To empty a layer
            that differs by more pays: raise it where renders have holes.
        min_area: smallest layer, in [0, 1] of the frame, counted in pixels that have a depth.
        weight: lambda of Eq. 15; tolerance 0.05.

    The penalty is 2 log 10: both layers at ten times the depth.
    """

    mode: Literal["robust", "faithful"] = "robust"
    mismatch: float = math.log(2)
    min_area: float = 0.005
    weight: float = 4.0

    requires: ClassVar[tuple[str, ...]] = ("depth", "layers")
    unit: ClassVar[str] = "log ratio"
    penalty: ClassVar[float] = 2 * math.log(10)
    groups: ClassVar[tuple[int, ...]] = (0, 1)
    signs: ClassVar[tuple[str, ...]] = ("background farther", "foreground farther")

    def __post_init__(self) -> None:
        if self.mismatch < 0:
            raise ValueError(f"mismatch must be >= 0, got {self.mismatch}")
        if not 0 <= self.min_area <= 1:
            raise ValueError(f"min_area must be in [0, 1], got {self.min_area}")

    def _depths(self, reference: Features, rendered: Features) -> tuple[Tensor, Tensor]:
        """Representative depths of the layers of both sides, (R, 3) and (B, 3)."""
        check_pair(reference, rendered)
        least = 0.0 if self.mode == "faithful" else self.min_area
        first = reference.once(("layer depths", least), lambda: layer_depths(reference, least))
        return first, layer_depths(rendered, least)

    def residuals(self, reference: Features, rendered: Features) -> Tensor:
        """Signed differences of both log ratios, (B, 2)."""
        first, second = self._depths(reference, rendered)
        if self.mode == "faithful":
            return _skip(log_depth_ratios(second) - log_depth_ratios(first))
        return space_differences(first, second, self.mismatch)

    def directions(self, reference: Features, rendered: Features) -> Tensor:
        """Signed differences of both log ratios, (B, 2), NaN where a side lacks the layer: that is no direction."""
        first, second = self._depths(reference, rendered)
        return log_depth_ratios(second) - log_depth_ratios(first)

    def beyond(self, reference: Features, rendered: Features) -> Tensor:
        """Both residuals as they would be beyond a jump of a mode, and how far it is from there, (B, 2, 2).

        The density of a layer's depths may have a peak nearer to what is wanted than its highest: residuals are told of
        that one. It becomes the mode where its lead, the log of the highest other one's height over its own, falls
        below 0. NaN where a side lacks the layer.
        """
        first, second = self._depths(reference, rendered)
        there = ~second[:, [2, 0]].isnan()
        wanted = (second[:, 1:2] * log_depth_ratios(first).exp()).masked_fill(~there, float("nan"))  # (B, 2)
        outer = layers_on(rendered, "depth")[:, [2, 0]]
        peak, lead = nearest_peak(rendered.require("depth"), outer, wanted).unbind(-1)
        return torch.stack([(peak / wanted).log(), lead], dim=-1)

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        """Raw loss, (B,); NaN where undefined."""
        return self.residuals(reference, rendered).abs().sum(-1)
