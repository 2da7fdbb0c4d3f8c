"""From a network's disparity to depth, and back to what its unknown scale and shift are."""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor

Align = Literal["raw", "shift", "metric"]
CONSTANT = 1e-5  # of the largest: what differs by less does so by rounding
OUTLIERS = (1.0, 0.5, 0.25, 0.1, 0.1, 0.1, 0.1)  # relative errors that count a quarter, one reweighting after another


def depth_from_disparity(
    disparity: Tensor, floor: float, align: Align = "raw", affine: tuple[float, float] = (1.0, 0.0)
) -> Tensor:
    """Depth (B, H, W) > 0 of disparity (B, H, W), up to the scale of the network, and its shift unless it is aligned.

    NaN where inverse depth is not above ``floor`` times the frame's largest: the sky, or too far to tell, as a
    renderer's depth is where nothing is. So a frame's depths span at most 1 / floor, and all of it is NaN where none is
    positive. NaN too where the network itself puts a disparity that near to 0: most have nothing below it to say of the
    sky, and a shift would make it a distance. What is below 0 is a disparity of one that goes there.
    """
    inverse, least = aligned(disparity, align, affine), floor * _largest(disparity)
    told = (disparity.abs() > least) & (inverse > floor * _largest(inverse))
    return torch.where(told, 1 / inverse, torch.nan)


def _largest(values: Tensor) -> Tensor:
    """The largest of each frame, at least 0, (B, 1, 1)."""
    return values.amax(dim=(1, 2), keepdim=True).clamp_min(0)


def aligned(disparity: Tensor, align: Align, affine: tuple[float, float]) -> Tensor:
    """Inverse depth (B, H, W), up to scale but without shift, of a network's disparity (B, H, W).

    ``metric`` takes a d + b; ``shift`` the same of d counted in the frame's largest, for a network that scales each
    frame by itself; ``raw`` takes d as it is.
    """
    if align == "raw":
        return disparity
    a, b = affine
    if align == "shift":
        disparity = disparity / disparity.amax(dim=(1, 2), keepdim=True).clamp_min(1e-12)
    return a * disparity + b


def fit_affine(disparity: Tensor, depth: Tensor) -> tuple[float, float]:
    """The (a, b) of 1 / depth = a d + b that fit best, robustly.

    Least squares of the relative error r of the inverse depth, reweighted by Geman and McClure's (c^2 / (c^2 + r^2))^2
    with c falling to 10 %, so that pixels far off (an edge, the sky) do not count.

    Args:
        disparity: of any pixels, (P,).
        depth: of the same pixels, (P,), > 0; NaN where unknown.

    Returns:
        a, b; NaN where fewer than two depths are known, or the disparity is constant but for rounding, there or where
        depths are not far off.
    """
    known = depth.isfinite() & (depth > 0) & disparity.isfinite()
    d, z = disparity[known].double(), depth[known].double()
    if len(d) < 2 or float(d.std()) <= CONSTANT * float(d.abs().max()):
        return float("nan"), float("nan")
    rows = torch.stack([d, torch.ones_like(d)], dim=1) * z[:, None]
    weight = torch.ones_like(z)
    solution = torch.zeros(2, dtype=torch.float64)
    for outlier in OUTLIERS:
        normal = rows.T @ (rows * weight[:, None])
        solution, singular = torch.linalg.solve_ex(normal, (rows * weight[:, None]).sum(0))
        if bool(singular) or not bool(solution.isfinite().all()):
            return float("nan"), float("nan")
        weight = (1 + ((rows @ solution - 1) / outlier) ** 2) ** -2
    return float(solution[0]), float(solution[1])
