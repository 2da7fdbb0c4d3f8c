"""Camera movement: how the layers of the frame move (paper Sec. 4.2.4)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import ClassVar, Literal

import torch
from kornia.metrics import aepe
from torch import Tensor
from torch.nn.functional import interpolate

from ..feature_shapes import check_mask, layers_on
from ..features import Features, check_pair
from ..registry import LOSSES
from ._affine_flow import AffineFlow, affine_flow_residuals, fit_affine_flow


def layer_endpoint_errors(reference: Tensor, rendered: Tensor, layers: Tensor) -> Tensor:
    """Endpoint error of the flow in each layer (paper Eq. 12).

    Args:
        reference: flow, (R, 2, H, W) [px], R = 1 or B.
        rendered: flow of B candidates, (B, 2, H, W) [px].
        layers: pixels compared, (B, 3, H, W) bool: those both sides count to the layer.

    Returns:
        (B, 3) [px], >= 0; NaN for a layer without a pixel that has both flows. Gradients are finite: 0 of pixels that
        are not compared or whose flows are equal.

    Raises:
        TypeError: ``layers`` is not bool.
    """
    check_mask("layers", layers)
    full = torch.promote_types(rendered.dtype, torch.float32)  # in half precision squares end at 255 px
    difference = rendered.to(full) - reference
    square = difference.square().sum(1, keepdim=True)
    counted, apart = layers & square.isfinite(), (square > 0) & square.isfinite()
    safe = difference.where(apart, 1.0).movedim(1, -1)  # a root has no slope at 0
    error = aepe(safe, torch.zeros_like(safe), reduction="none")[:, None].where(apart, 0.0)
    count = counted.flatten(2).sum(-1)
    mean = error.where(counted, 0.0).flatten(2).sum(-1) / count.clamp_min(1)
    return mean.masked_fill(count == 0, float("nan"))


def movement_residuals(
    reference: AffineFlow, rendered: AffineFlow, mismatch: float, min_area: float, min_share: float = 0.0
) -> Tensor:
    """Six residuals a layer whose norms add up to the mean difference of the layers' affine flow.

    A layer differs by :data:`WHIP` at most: a field fitted to a sliver of the render says nothing beyond it.

    Args:
        reference: fields of 1 or B frames.
        rendered: fields of B candidates.
        mismatch: cost of a layer that the reference has and the render lacks, >= 0 [frame widths].
        min_area: a layer with flow on a smaller part of the frame counts as lacking.
        min_share: so does one of the render with flow on a smaller share of the reference layer's area.

    Returns:
        (B, 18) [frame widths]; NaN where the reference has no layer or the render none of those.
    """
    wanted = reference.area >= min_area  # (R, 3)
    there = rendered.area >= (min_share * reference.area).clamp_min(min_area)  # (B, 3)
    residuals = affine_flow_residuals(reference, rendered)
    residuals = residuals * (WHIP / residuals.norm(dim=-1, keepdim=True)).clamp_max(1.0)
    lacking = torch.zeros(6).to(residuals)
    lacking[0] = mismatch
    residuals = torch.where(there[..., None], residuals, lacking)
    residuals = residuals.masked_fill(~wanted[..., None], 0.0) / wanted.sum(-1)[:, None, None]
    return residuals.flatten(1).masked_fill(~(there & wanted).any(-1, keepdim=True), float("nan"))


def weight_note(losses: Mapping[str, object], width: int) -> str:
    """What is wrong with the weight of camera movement against a reference ``width`` px wide; empty where nothing is.

    Modes differ in their unit: the weight that is meant for one makes the other all of the total, or nothing of it. A
    weight of 0 is meant.
    """
    loss = losses.get("camera_movement")
    if not isinstance(loss, CameraMovement) or loss.weight == 0:
        return ""
    usual, unit = (WEIGHT / width, f"pixels of frames {width} wide") if loss.mode == "faithful" else (WEIGHT, loss.unit)
    share = loss.weight / usual
    if 1 / OTHER_MODE < share < OTHER_MODE:
        return ""
    counts = f"{share:.0f} times" if share > 1 else f"1/{1 / share:.0f} of"
    asked = f"camera_movement counts {counts} what its tolerance asks for, mode {loss.mode} being in {unit}"
    return f"{asked}: set losses.camera_movement.weight={usual:.3g}"


WHIP = 0.25  # a whip pan: a quarter of the frame width in one frame
WEIGHT = 40.0  # 1 / (5 * tolerance) for a tolerance of 0.005 frame widths
OTHER_MODE = 50.0  # a weight so many times too large or too small is that of the other mode: of frames as many px wide


@LOSSES.register("camera_movement")
@dataclass(frozen=True)
class CameraMovement:
    """Difference of the backward optical flow, layer by layer (paper Eq. 11-12).

    Undefined on the first frame, which has no flow.

    Args:
        mode: ``faithful`` is the endpoint error in pixels of the reference over the pixels that both sides
            count to a layer; it depends on the resolution and needs overlapping persons. The mean is over the
            layers that both sides have, where Eq. 11 counts a missing one as 0. ``robust`` fits an
            affine field to each layer of either side, weighted by the flow's confidence where that was extracted,
            and compares the fields over the reference's pixels.
        layered: compare foreground, person and background apart (Eq. 11); else the frame as one layer, as JAWS does.
        mismatch: cost of a layer that only the reference has, >= 0 [frame widths] (robust).
        min_area: smallest layer, in (0, 1] of the frame (robust).
        min_share: smallest part of a layer's area in the reference that the render must show, in [0, 1] (robust): a
            field seen through a keyhole says nothing about the frame.
        weight: lambda of Eq. 15; tolerance 0.005 frame widths. It is by the unit: for ``faithful`` divide it by the
            width of the reference [px], see :func:`weight_note`.

    The penalty is a quarter of the frame width in one frame, a whip pan, and the most that a layer can differ by, so
    that to lose all of them never pays; to lose one that differs by more than ``mismatch`` does. Faithful: that of a
    frame 1280 wide; to lose a layer that differs more than the others pays.
    """

    mode: Literal["robust", "faithful"] = "robust"
    layered: bool = True
    mismatch: float = 0.02
    min_area: float = 0.005
    min_share: float = 0.2
    weight: float = WEIGHT

    requires: ClassVar[tuple[str, ...]] = ("flow", "layers")
    uses: ClassVar[tuple[str, ...]] = ("flow_confidence",)
    unit: ClassVar[str] = "frame widths"
    penalty: ClassVar[float] = WHIP
    groups: ClassVar[tuple[int, ...]] = (0,) * 6 + (1,) * 6 + (2,) * 6

    def __post_init__(self) -> None:
        if self.mismatch < 0:
            raise ValueError(f"mismatch must be >= 0, got {self.mismatch}")
        if not 0 < self.min_area <= 1:
            raise ValueError(f"min_area must be in (0, 1], got {self.min_area}")
        if not 0 <= self.min_share <= 1:
            raise ValueError(f"min_share must be in [0, 1], got {self.min_share}")
        if not self.layered:
            object.__setattr__(self, "requires", ("flow",))
        if self.mode == "faithful":
            object.__setattr__(self, "unit", "px")
            object.__setattr__(self, "uses", ())
            object.__setattr__(self, "penalty", 320.0)
            object.__setattr__(self, "groups", (0, 1, 2))

    def residuals(self, reference: Features, rendered: Features) -> Tensor:
        """Differences of the affine fields, (B, 18) [frame widths]; faithful: of each layer, (B, 3) [px]."""
        check_pair(reference, rendered)
        if self.mode == "robust":
            key = ("affine flow", type(self), repr(self))  # a class of another's may fit otherwise, by its own options
            wanted, found = (side.once(key, partial(self._fit, side)) for side in (reference, rendered))
            return movement_residuals(wanted, found, self.mismatch, self.min_area, self.min_share)
        flow, layers = _on_grid_of(reference, rendered, self._layers(rendered))
        layers = layers & self._layers(reference)
        errors = layer_endpoint_errors(reference.require("flow"), flow, layers)
        there = errors.isfinite()  # Eq. 11, but for the missing ones
        return errors.masked_fill(~there & there.any(-1, keepdim=True), 0) / there.sum(-1, keepdim=True)

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        """Raw loss, (B,) [frame widths; faithful: px]; NaN where undefined."""
        return self.residuals(reference, rendered).unflatten(1, (3, -1)).norm(dim=-1).sum(-1)

    def _fit(self, features: Features) -> AffineFlow:
        layers = self._layers(features)
        return fit_affine_flow(features.require("flow"), layers, features.size, features.flow_confidence)

    def _layers(self, features: Features) -> Tensor:
        """Layers compared, (B, 3, H, W) bool on the pixels of the flow; the whole frame stands in the first place."""
        flow = features.require("flow")
        if self.layered:
            return layers_on(features, "flow")
        whole = torch.zeros(len(flow), 3, *flow.shape[2:], dtype=torch.bool, device=flow.device)
        whole[:, 0] = True
        return whole


def _on_grid_of(reference: Features, rendered: Features, layers: Tensor) -> tuple[Tensor, Tensor]:
    """Flow and ``layers`` of ``rendered`` on the pixels of ``reference``, vectors in its pixels."""
    flow = rendered.require("flow")
    flow = flow.to(torch.promote_types(flow.dtype, torch.float32))  # scaled by parts of a pixel
    grid = tuple(reference.require("flow").shape[-2:])
    scale = flow.new_tensor([a / b for a, b in zip(reference.size, rendered.size)])[:, None, None]
    flow = interpolate(flow, grid, mode="nearest-exact") * scale
    return flow, interpolate(layers.float(), grid, mode="nearest-exact") > 0.5
