"""The motion of a layer as six numbers: an affine field fitted to its optical flow."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from ..computer.arrays import plain

ROUNDED = 0.02  # by which shapes of frames differ where one is a smaller copy of the other
RIDGE = 1e-8  # added to the second moments, so that a layer one pixel wide still has a fit


@dataclass(frozen=True)
class AffineFlow:
    """Affine flow fields of K layers in B frames, over (1, u, v) with u, v in [-0.5, 0.5] across the frame.

    Args:
        coefficients: of both flow components, (B, K, 2, 3) [frame widths]; NaN where the layer has no flow.
        moments: mean of (1, u, v) (1, u, v)^T over the layer's pixels, (B, K, 3, 3), positive definite.
        area: the layer's pixels that have a flow, each as far as it is trusted, as a part of the frame, (B, K) in
            [0, 1].
        aspect: height of the frame over its width, which u and v are across.
    """

    coefficients: Tensor  # (B, K, 2, 3)
    moments: Tensor  # (B, K, 3, 3)
    area: Tensor  # (B, K)
    aspect: float


def fit_affine_flow(
    flow: Tensor, layers: Tensor, size: tuple[int, int], confidence: Tensor | None = None
) -> AffineFlow:
    """Least-squares affine field of each layer's flow, weighted by its confidence.

    It holds what a mean flow is blind to: push, zoom and roll have no mean but a gradient. Pixels without a
    flow (NaN) are left out. The fit does not depend on the grid that the flow is told on.

    Args:
        flow: (B, 2, H, W) [px of a frame of that ``size``].
        layers: (B, K, H, W) bool.
        size: (width, height) of the frame that the flow vectors refer to [px].
        confidence: weight of each pixel, (B, H, W) in [0, 1]; None trusts all alike.

    Returns:
        The fields in frame widths, float64.

    Raises:
        ValueError: flow, layers and confidence are not on one grid.
    """
    from ._kernels import flow_sums

    if flow.shape != (len(layers), 2, *layers.shape[2:]):
        raise ValueError(f"flow and layers must share a grid, got {tuple(flow.shape)} and {tuple(layers.shape)}")
    weight = torch.ones_like(flow[:, 0]) if confidence is None else confidence
    if weight.shape != flow[:, 0].shape:
        raise ValueError(f"flow and confidence must share a grid, got {tuple(flow.shape)} and {tuple(weight.shape)}")
    sums = torch.from_numpy(flow_sums(plain(flow), plain(weight), plain(layers))).to(flow.device)
    count = sums[..., :1]
    mean = sums / count.where(count > 0, 1)
    moments = mean[..., [0, 1, 2, 1, 3, 4, 2, 4, 5]].unflatten(-1, (3, 3))
    ridge = torch.diag(torch.tensor([0, RIDGE, RIDGE], dtype=sums.dtype, device=sums.device))
    empty = count[..., None] == 0  # (B, K, 1, 1)
    moments = torch.where(empty, torch.eye(3).to(sums), moments + ridge)
    crossed = mean[..., 6:].unflatten(-1, (2, 3)) / size[0]
    coefficients = torch.linalg.solve(moments, crossed.transpose(-1, -2)).transpose(-1, -2)
    area = count[..., 0] / (layers.shape[-1] * layers.shape[-2])
    return AffineFlow(coefficients.masked_fill(empty, float("nan")), moments, area, size[1] / size[0])


def affine_flow_residuals(reference: AffineFlow, rendered: AffineFlow) -> Tensor:
    """Difference of two fields over the reference layer's pixels, as six numbers a layer.

    Their sum of squares is the mean squared endpoint error of the fields over those pixels, in closed form:
    with d the difference of the coefficients and M = L L^T the moments, d^T M d = |L^T d|^2. A field of frames of
    another shape is taken at equal heights in frame widths, where a push of the camera is the same in both.

    Args:
        reference: R = 1 or B frames.
        rendered: B frames.

    Returns:
        (B, K, 6) [frame widths]; NaN where either side has no field.
    """
    field, taller = rendered.coefficients, reference.aspect / rendered.aspect
    if abs(math.log(taller)) > ROUNDED:
        field = field * field.new_tensor([1, 1, taller])
    difference = field - reference.coefficients  # (B, K, 2, 3)
    return (difference @ torch.linalg.cholesky(reference.moments)).flatten(-2)
