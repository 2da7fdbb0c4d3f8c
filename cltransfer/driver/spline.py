"""Paths of few parameters: B-splines fitted to a path through what the losses make of every frame.

Every frame found brings its residuals and their Jacobian, so the whole clip is one linear least squares problem in the
spline's coefficients, reweighted for the group norms; it is solved without rendering anything.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..along_clip import counted
from ..pipeline.objective import group_norms
from .refine import LONGEST

if TYPE_CHECKING:
    from scipy import sparse

# lowest group norm that is told apart, round by round; the last is what terms are given up by for another that is dear
FLOORS = (0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005)
RIDGE = 1e-3  # of the distance to the path, for what no residual determines
DEGREE = 3
STIFFNESS = 250.0  # total that a third difference of x costs, squared and halved: 0.05 where it is 0.02 in the mean


@dataclass(frozen=True)
class Local:
    """What the losses make of N frames near where they were found.

    Args:
        residuals: weighted, (N, R).
        jacobian: of each frame's residuals by its own x, (N, R, D).
        groups: group of each residual, (R,).
        paired: residuals that compare a frame with the one before, (R,) bool.
    """

    residuals: Tensor  # (N, R)
    jacobian: Tensor  # (N, R, D)
    groups: Tensor  # (R,)
    paired: Tensor  # (R,)

    @property
    def total(self) -> float:
        """Mean total of the frames."""
        return float(group_norms(self.residuals, self.groups).sum(1).mean())

    @cached_property
    def slope(self) -> sparse.csr_array:
        """Change of all residuals (N R) by all of x (N D).

        A residual between two frames changes by the one before as by its own, the other way: their motion is what it
        measures, and it is small.
        """
        from scipy import sparse

        own = self.jacobian.numpy()
        rows = sparse.block_diag(list(own), format="csr")
        if len(own) == 1:
            return rows
        before = sparse.block_diag(list(-own[1:] * self.paired.numpy()[:, None]), format="coo")
        R = own.shape[1]
        return rows + sparse.csr_array((before.data, (before.row + R, before.col)), shape=rows.shape)


@dataclass(frozen=True)
class Fitted:
    """A spline through a path.

    Args:
        x: (N, D).
        predicted: mean total by the linear model; None where there is none.
    """

    x: Tensor  # (N, D)
    predicted: float | None


def basis(at: Tensor, knots: int) -> NDArray:
    """Values (N, knots) of the B-splines of a path whose frames stand ``at`` (N,): constant, linear, quadratic, cubic.

    >>> basis(torch.tensor([0.0, 1.0, 4.0]), 2).round(2).tolist()
    [[1.0, 0.0], [0.75, 0.25], [0.0, 1.0]]
    """
    from scipy.interpolate import BSpline

    degree = min(DEGREE, knots - 1)
    inner = np.linspace(0, 1, knots - degree + 1)
    places = np.concatenate([np.zeros(degree), inner, np.ones(degree)])
    times = at.numpy() * (1 / at[-1].item()) if len(at) > 1 else np.zeros(1)
    times[-1] = 1.0 if len(at) > 1 else 0.0
    return BSpline.design_matrix(times, places, degree).toarray()


def fit(x: Tensor, local: Local | None, knots: int, fixed: Tensor | None = None, at: Tensor | None = None) -> Fitted:
    """The spline of ``knots`` coefficients a dimension that costs least.

    Args:
        x: path that it is fitted to, (N, D) float64.
        local: what the losses make of it; None fits x itself.
        knots: at least 1, at most N.
        fixed: direction (D,) along which nothing may change, e.g. the focal length's; None leaves all free.
        at: places of the frames along the clip, (N,); None are evenly spaced.
    """
    from scipy import sparse
    from scipy.sparse.linalg import spsolve

    design, path = _design(x, knots, fixed, counted(len(x), at)), x.numpy().ravel()
    if local is None:
        best = design @ spsolve((design.T @ design).tocsc(), design.T @ path)
        return Fitted(torch.from_numpy(best).reshape(x.shape), None)
    r, slope = local.residuals.numpy().ravel(), local.slope
    along, offset = (slope @ design).tocsr(), slope @ path - r
    norms, best = group_norms(local.residuals, local.groups), path
    for floor in FLOORS:
        weight = (1 / norms.clamp_min(floor))[:, local.groups].numpy().ravel()
        weighted = along.T @ sparse.diags_array(weight)
        normal = (weighted @ along + RIDGE * (design.T @ design)).tocsc()
        best = design @ spsolve(normal, weighted @ offset + RIDGE * (design.T @ path))
        predicted = torch.from_numpy(r + slope @ (best - path)).reshape(local.residuals.shape)
        norms = group_norms(predicted, local.groups)
    return Fitted(torch.from_numpy(best).reshape(x.shape), float(norms.sum(1).mean()))


def bending(x: Tensor, about: Tensor | None = None, at: Tensor | None = None) -> float:
    """Total that the bends of a path x (N, D) are worth, those of ``about`` (N, D) apart; 0 below four frames.

    Its frames stand ``at`` (N,), or are evenly spaced.
    """
    if at is None:
        thirds = _added(x, about).diff(n=3, dim=0)
    else:
        thirds = torch.from_numpy(_thirds(at) @ _added(x, about).numpy())
    return STIFFNESS / 2 * float((thirds**2).sum()) / len(x)


def _added(x: Tensor, about: Tensor | None) -> Tensor:
    return x if about is None else x - about


def moved(
    x: Tensor,
    local: Local,
    knots: int,
    damping: float,
    fixed: Tensor | None = None,
    about: Tensor | None = None,
    at: Tensor | None = None,
) -> Fitted:
    """The path moved by the spline of ``knots`` coefficients a dimension that costs least, by the model.

    Args:
        x: the path, (N, D) float64.
        local: what the losses make of it.
        knots: at least 1, at most N.
        damping: of the step, relative to the curvature in each coefficient (Levenberg-Marquardt).
        fixed: direction (D,) along which all frames move alike; None leaves all free.
        about: path (N, D) whose own bends cost nothing; None is a straight one.
        at: places of the frames along the clip, (N,); None are evenly spaced.
    """
    from scipy import sparse
    from scipy.sparse.linalg import spsolve

    stands = counted(len(x), at)
    design, r = _design(x, knots, fixed, stands), local.residuals.numpy().ravel()
    along = (local.slope @ design).tocsr()
    bends = _third_differences(stands, x.shape[1])
    stiff, bent = bends @ design, bends @ _added(x, about).numpy().ravel()
    norms = group_norms(local.residuals, local.groups)
    for floor in FLOORS[1:]:
        weight = (1 / norms.clamp_min(floor))[:, local.groups].numpy().ravel()
        weighted = along.T @ sparse.diags_array(weight)
        curvature = weighted @ along + STIFFNESS * (stiff.T @ stiff)
        scale = curvature.diagonal()
        scale = np.maximum(scale, 1e-5 * scale.mean() + 1e-9)
        downhill = -(weighted @ r + STIFFNESS * (stiff.T @ bent))
        step = spsolve((curvature + damping * sparse.diags_array(scale)).tocsc(), downhill)
        change = torch.from_numpy(along @ step).reshape(local.residuals.shape)
        norms = group_norms(local.residuals + change, local.groups)
    move = torch.from_numpy(design @ step).reshape(x.shape)
    part = min(1.0, LONGEST / max(float(move.abs().max()), 1e-12))
    norms = group_norms(local.residuals + part * change, local.groups)
    return Fitted(x + part * move, float(norms.sum(1).mean()))


def _third_differences(at: Tensor, dimensions: int) -> sparse.csr_array:
    """A path laid out frame by frame to its third differences, (max(N - 3, 0) D, N D)."""
    from scipy import sparse

    return sparse.kron(_thirds(at), np.eye(dimensions), format="csr")


def _thirds(at: Tensor) -> sparse.csr_array:
    """Values of N frames to their third differences, (max(N - 3, 0), N): -1, 3, -3, 1 where they are evenly spaced.

    Six times the divided differences.
    """
    from scipy import sparse

    count = max(len(at) - 3, 0)
    if not count:
        return sparse.csr_array((0, len(at)))
    four = at.unfold(0, 4, 1).numpy()  # (N - 3, 4)
    apart = four[:, :, None] - four[:, None, :] + np.eye(4)  # of a place from itself: a factor of one
    return sparse.diags_array(list((6 / apart.prod(2)).T), offsets=[0, 1, 2, 3], shape=(count, len(at)), format="csr")


def _design(x: Tensor, knots: int, fixed: Tensor | None, at: Tensor) -> sparse.csr_array:
    """Coefficients to the path laid out frame by frame, (N D, C)."""
    from scipy import sparse

    frames, dimensions = x.shape
    curve = sparse.csr_array(basis(at, knots))
    if fixed is None:
        return sparse.kron(curve, np.eye(dimensions), format="csr")
    row = int(fixed.abs().argmax())
    turned = np.eye(dimensions)
    turned[row] = fixed.numpy()  # x -> coordinates, one of them along the fixed direction
    back = np.linalg.inv(turned)
    moving = sparse.kron(curve, np.delete(back, row, axis=1))
    still = sparse.kron(np.ones((frames, 1)), back[:, [row]])
    return sparse.hstack([moving, still], format="csr")
