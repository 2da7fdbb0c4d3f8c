"""One point in the world from its pixels in many views, some of which are wrong."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ...camera import Camera

BLOCK = 2**18  # errors of pairs that are looked at together: 10 MB


@dataclass(frozen=True)
class Triangulated:
    """A point and how well the views agree on it.

    Args:
        point: (3,) world; NaN where fewer than two views agree.
        agreed: views whose pixel lies within the tolerance, (V,) bool.
        error: reprojection error in every view given, (V,) [px]; NaN where the view has no pixel.
    """

    point: Tensor  # (3,)
    agreed: Tensor  # (V,) bool
    error: Tensor  # (V,) [px]


def triangulate(cameras: Camera, pixels: Tensor, seen: Tensor, tolerance: float) -> Triangulated:
    """Robust triangulation: the pair of views that most others agree with, then all that agree.

    The result is that of every pair tried, so it does not depend on chance; nor on where the world has its origin.

    Args:
        cameras: V views.
        pixels: (V, 2) [px].
        seen: which views have a pixel, (V,) bool.
        tolerance: largest reprojection error of a view that agrees [px].
    """
    views = seen.nonzero()[:, 0]
    agreed = torch.zeros(len(cameras), dtype=torch.bool)
    error = torch.full((len(cameras),), float("nan"), dtype=torch.float64)
    if len(views) < 2:
        return Triangulated(torch.full((3,), float("nan"), dtype=torch.float64), agreed, error)
    P = (cameras.K @ cameras.w2c[:, :3])[views]  # (V, 3, 4)
    middle = cameras.center[views].mean(0)  # from there: the linear method draws points towards the origin
    P = torch.cat([P[..., :3], P[..., 3:] + P[..., :3] @ middle[:, None]], dim=-1)
    xy = pixels[views].double()
    best = _largest(P, xy, tolerance)
    if int(best.sum()) < 2:
        return Triangulated(torch.full((3,), float("nan"), dtype=torch.float64), agreed, error)
    point = _intersect(P[best][None], xy[best][None])
    final = _reprojection(P, xy, point)[0]
    error[views] = final
    agreed[views] = final < tolerance
    return Triangulated(point[0] + middle, agreed, error)


def _largest(P: Tensor, xy: Tensor, tolerance: float) -> Tensor:
    """Views (V,) bool that agree with the pair that most agree with.

    No pair is better than one that all agree with, and a few pairs far apart find it where no view is wrong: their
    errors are V^2 / 2, those of all pairs V^3 / 2.
    """
    views = torch.arange(len(P))
    half = len(P) // 2
    apart = torch.stack([views[:-half], views[half:]], dim=1)
    if bool((_of_pairs(P, xy, apart) < tolerance).all(1).any()):
        return torch.ones(len(P), dtype=torch.bool)
    pairs = torch.combinations(views, 2)  # (M, 2)
    blocks = pairs.split(max(1, BLOCK // len(P)))  # few pairs at a time: M V errors grow with the cube of V
    agreeing = torch.cat([_agreeing(_of_pairs(P, xy, block), tolerance) for block in blocks])  # (M,)
    return _of_pairs(P, xy, pairs[int(agreeing.argmax())][None])[0] < tolerance


def _of_pairs(P: Tensor, xy: Tensor, pairs: Tensor) -> Tensor:
    """Errors (M, V) [px] in every view of the points that pairs (M, 2) of views see."""
    return _reprojection(P, xy, _intersect(P[pairs], xy[pairs]))


def _agreeing(errors: Tensor, tolerance: float) -> Tensor:
    """How good points with errors (M, V) [px] are, (M,): by most views, then by the closest."""
    close = errors < tolerance
    count = close.sum(1)
    mean_error = torch.where(close, errors, 0.0).sum(1) / count.clamp_min(1)
    return count - mean_error / (2 * tolerance)


def _intersect(P: Tensor, xy: Tensor) -> Tensor:
    """Points (M, 3) nearest to the rays of pixels (M, V, 2) under projections (M, V, 3, 4), by the linear method."""
    rows = xy[..., None] * P[:, :, 2:3] - P[:, :, :2]  # (M, V, 2, 4)
    rows = rows / rows[..., :3].norm(dim=-1, keepdim=True)
    solution = torch.linalg.svd(rows.flatten(1, 2)).Vh[:, -1]
    return solution[:, :3] / solution[:, 3:]


def _reprojection(P: Tensor, xy: Tensor, points: Tensor) -> Tensor:
    """Errors (M, V) [px] of points (M, 3) in views P (V, 3, 4); infinite behind a camera."""
    homogeneous = torch.cat([points, torch.ones_like(points[:, :1])], dim=1)
    seen = torch.einsum("vij,mj->mvi", P, homogeneous)
    error = (seen[..., :2] / seen[..., 2:] - xy).norm(dim=-1)
    return torch.where(seen[..., 2] > 0, error, torch.inf)
