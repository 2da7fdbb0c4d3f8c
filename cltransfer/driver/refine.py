"""Refinement by iteratively reweighted Levenberg-Marquardt with a Broyden Jacobian, on losses that have residuals.

The total is a sum of group norms, so each group is weighted by the inverse of its norm (IRLS), never beyond a floor
that shrinks from step to step. Finite differences are taken on geometry, where evaluations are exact, and kept from
frame to frame; each step tries several dampings as one batch.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from ..pipeline.objective import group_norms

STEP = 2e-3  # of the finite differences, in the units of x
FLOORS = (0.2, 0.06, 0.02, 0.01)  # lowest group norm that is told apart, step by step; 0.2 is one tolerance
LONGEST = 0.5  # longest step in any parameter, in the units of x
FLATTEST = 1e-2  # of the largest curvature, that is added to all: no direction is trusted to be flatter
WORTH = 1e-3  # relative decrease below which the last floor ends it


@dataclass(frozen=True)
class Refinement:
    """How far one frame is refined.

    Args:
        steps: at most.
        dampings: tried together in each step, relative to the running one.
        jacobians: computed afresh at most; the first frame always has one.
        tolerance: total that is good enough.
    """

    steps: int = 8
    dampings: tuple[float, ...] = (1e-3, 3e-2, 1.0)
    jacobians: int = 2
    tolerance: float = 0.0


@dataclass(frozen=True)
class Refined:
    """Where it ended.

    Args:
        x: (D,).
        total: there, of the residuals as they were given: a frame's count flow by half (:data:`.problem.MOTION`).
        residuals: there, (R,).
        jacobian: (R, D), for the next frame.
        stop: tolerance, worth (nothing to gain) or steps.
    """

    x: Tensor  # (D,)
    total: float
    residuals: Tensor  # (R,)
    jacobian: Tensor  # (R, D)
    stop: str


Bounds = tuple[Tensor, Tensor]  # lowest and highest x, (D,) each; infinite where free


def refine(
    evaluate: Callable[[Tensor], Tensor],
    x: Tensor,
    groups: Tensor,
    options: Refinement,
    jacobian: Tensor | None,
    bounds: Bounds | None = None,
    residuals: Tensor | None = None,
) -> Refined:
    """Decrease the sum of group norms of the residuals from ``x``.

    Args:
        evaluate: weighted residuals (B, R) of x (B, D).
        x: where to begin, (D,) float64.
        groups: group of each residual, (R,).
        options: how far.
        jacobian: of the frame before, (R, D); None computes one.
        bounds: steps end on them; None is free.
        residuals: at ``x``, (R,), which is then within bounds; None evaluates them.
    """
    x = inside(x, bounds)
    r = evaluate(x[None])[0] if residuals is None else residuals
    total = begun = float(group_norms(r[None], groups).sum())
    fresh, made, damping, stop = False, 0, 1.0, "steps"
    for step in range(options.steps):
        if total <= options.tolerance:
            stop = "tolerance"
            break
        if jacobian is None:
            jacobian = differences(evaluate, x, r, bounds)
            fresh, made = True, made + 1
        floor = FLOORS[min(step, len(FLOORS) - 1)]
        tried = inside(_steps(x, r, jacobian, groups, floor, [d * damping for d in options.dampings]), bounds)
        found = evaluate(tried)
        totals = group_norms(found, groups).sum(1)
        k = int(totals.argmin())
        if float(totals[k]) < total - 1e-9:
            gain, moved = total - float(totals[k]), tried[k] - x
            jacobian = jacobian + torch.outer(found[k] - r - jacobian @ moved, moved) / (moved @ moved)  # Broyden
            x, r, total, fresh = tried[k], found[k], float(totals[k]), False
            damping = max(0.3 * damping, 1e-3) if k == 0 else damping * (3.0 if k == len(tried) - 1 > 0 else 1.0)
            if gain < WORTH * max(total, 0.2) and step >= len(FLOORS) - 1:
                stop = "worth"
                break
        elif fresh or made >= options.jacobians:
            damping *= 10
            if floor == FLOORS[-1] or damping > 1e3:
                stop = "worth"
                break
        else:
            jacobian = differences(evaluate, x, r, bounds)
            fresh, made = True, made + 1
    if stop == "steps" and options.steps and begun - total < WORTH * max(total, 0.2):
        stop = "worth"  # few steps never come to the last floor, but nothing was gained by all of them
    if jacobian is None:
        jacobian = differences(evaluate, x, r, bounds)
    return Refined(x, total, r, jacobian, stop)


def inside(x: Tensor, bounds: Bounds | None) -> Tensor:
    """x (..., D) moved onto the bounds where it lies beyond."""
    return x if bounds is None else torch.minimum(torch.maximum(x, bounds[0]), bounds[1])


def inward(x: Tensor, width: float, bounds: Bounds | None) -> Tensor:
    """Steps (..., D) of differences from x: ``width``, backwards where forwards leaves the box."""
    step = torch.full_like(x, width)
    return step if bounds is None else torch.where(x + width > bounds[1], -step, step)


def differences(
    evaluate: Callable[[Tensor], Tensor], x: Tensor, r: Tensor, bounds: Bounds | None, width: float = STEP
) -> Tensor:
    """Jacobian (R, D) by one-sided differences, all as one batch.

    Args:
        evaluate: residuals (B, R) of x (B, D).
        x: where, (D,).
        r: residuals there, (R,).
        bounds: of x; None is free.
        width: of the differences, in the units of x.
    """
    step = inward(x, width, bounds)
    return ((evaluate(x + torch.diag(step)) - r) / step[:, None]).T


def _steps(x: Tensor, r: Tensor, J: Tensor, groups: Tensor, floor: float, dampings: list[float]) -> Tensor:
    """Candidates (M, D), one for each damping, from the reweighted normal equations."""
    norms = group_norms(r[None], groups)[0].clamp_min(floor)
    weighted = J / norms[groups][:, None]
    A, b = weighted.T @ J, -(weighted.T @ r)
    scale = A.diagonal().clamp_min(1e-6 * float(A.trace()) + 1e-9)
    moves = torch.stack([torch.linalg.solve(A + torch.diag(d * scale), b) for d in dampings])
    longest = moves.abs().amax(1, keepdim=True)
    return x + moves * (LONGEST / longest.clamp_min(LONGEST))


def least_curvature(J: Tensor, r: Tensor, groups: Tensor) -> float:
    """Smallest eigenvalue of J^T W J: near 0, some direction of the camera costs nothing and is not determined."""
    return float(torch.linalg.eigvalsh(_curvature(J, r, groups))[0])


def flat_directions(J: Tensor, r: Tensor, groups: Tensor) -> Tensor:
    """Square root (D, D) of the inverse of J^T W J, its longest axis 1 long: where CMA-ES is to begin with long steps.

    Round where nothing changes in any direction.

    Args:
        J: Jacobian, (R, D).
        r: residuals, (R,).
        groups: group of each residual, (R,).
    """
    values, vectors = torch.linalg.eigh(_curvature(J, r, groups))
    if not values[-1] > 0:
        return torch.eye(len(values), dtype=values.dtype)
    axes = (values.clamp_min(0) + FLATTEST * values[-1]).rsqrt()
    return vectors * (axes / axes.max())


def _curvature(J: Tensor, r: Tensor, groups: Tensor) -> Tensor:
    """J^T W J (D, D), each group weighted by the inverse of its norm."""
    norms = group_norms(r[None], groups)[0].clamp_min(FLOORS[0])
    return (J / norms[groups][:, None]).T @ J
