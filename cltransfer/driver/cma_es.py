"""CMA-ES by ask and tell around pycma: our own random numbers, our own stop rules, one batch a generation."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from .refine import inside

DECREASE = 1e-6  # relative; a smaller decrease of the best total does not count: the paper leaves open how much does


@dataclass(frozen=True)
class Budget:
    """When one minimisation ends.

    Args:
        generations: at most.
        patience: generations without decrease of the best total asked so far.
        popsize: candidates a generation.
        tolerance: total that is good enough.
    """

    generations: int = 100
    patience: int = 20
    popsize: int = 10
    tolerance: float = 0.0


@dataclass(frozen=True)
class Minimum:
    """The best candidate and how it was found.

    Args:
        x: best vector, (D,) float64.
        total: its total.
        generations: asked and told.
        stop: tolerance, patience or generations.
        shape: square root of the covariance it ended with, (D, D), its longest axis 1 long: which directions are flat.
    """

    x: Tensor  # (D,)
    total: float
    generations: int
    stop: str
    shape: Tensor  # (D, D)


@dataclass(frozen=True)
class Start:
    """Where a minimisation begins.

    Args:
        x: (D,) float64.
        sigma: step size along the longest axis of ``shape``, in the units of x.
        shape: (D, D) square root of a covariance with a longest axis of 1; None is round.
    """

    x: Tensor  # (D,)
    sigma: float
    shape: Tensor | None = None  # (D, D)


def minimise(
    evaluate: Callable[[Tensor], Tensor],
    start: Start,
    bounds: tuple[Tensor, Tensor],
    budget: Budget,
    generator: np.random.Generator,
) -> Minimum:
    """Minimise ``evaluate`` from ``start`` by CMA-ES (paper Sec. 4.3).

    pycma's own stop rules are off, because a flat fitness would stop it at generation 0; its random numbers come from
    ``generator``, so no global seed is touched. The start itself is evaluated: the result is never worse than it.

    Args:
        evaluate: totals (B,) of x (B, D), finite.
        start: where to begin.
        bounds: lowest and highest x, (D,) each; infinite where free. Candidates outside are reflected.
        budget: when to stop.
        generator: source of every random number.
    """
    import cma

    low, high = bounds
    shape = torch.eye(len(low), dtype=torch.float64) if start.shape is None else start.shape
    origin = inside(start.x.double(), bounds)

    def to_x(asked: list[np.ndarray]) -> Tensor:
        return reflected(origin + torch.from_numpy(np.stack(asked)) @ shape.T, low, high)

    options = {
        "verbose": -9,
        "seed": math.nan,  # pycma then leaves numpy's global state alone
        "randn": lambda *shape: generator.standard_normal(shape),
        "popsize": budget.popsize,
    }
    strategy = cma.CMAEvolutionStrategy(np.zeros(len(low)), start.sigma, options)
    best, total = origin, float(evaluate(origin[None])[0])
    # a good start is hard to beat until the steps have shrunk, so patience watches what was asked, not the start
    asked_best = math.inf
    waited, generation, stop = 0, 0, "generations"
    while generation < budget.generations:
        if total <= budget.tolerance or waited >= budget.patience:
            stop = "tolerance" if total <= budget.tolerance else "patience"
            break
        asked = strategy.ask()
        x = to_x(asked)
        totals = evaluate(x)
        strategy.tell(asked, totals.tolist())
        generation, waited = generation + 1, waited + 1
        index, lowest = int(totals.argmin()), float(totals.min())
        if lowest < asked_best * (1 - DECREASE):
            asked_best, waited = lowest, 0
        if lowest < total:
            best, total = x[index], lowest
    return Minimum(best, total, generation, stop, _shape(strategy, shape))


def reflected(x: Tensor, low: Tensor, high: Tensor) -> Tensor:
    """x (B, D) folded back into the box as often as it takes; an infinite bound folds nothing.

    >>> reflected(torch.tensor([[1.25, -3.0]]), torch.tensor([-1.0, -torch.inf]), torch.tensor([1.0, torch.inf]))
    tensor([[ 0.7500, -3.0000]])
    """
    width = high - low
    folded = low + width - ((x - low).remainder(2 * width) - width).abs()
    above = torch.where(torch.isfinite(low), low + (x - low).abs(), x)
    below = torch.where(torch.isfinite(high), high - (high - x).abs(), above)
    return torch.where(torch.isfinite(width), folded, below)


def _shape(strategy: Any, before: Tensor) -> Tensor:
    """Square root of the strategy's covariance in the units of x, its longest axis 1 long."""
    values, vectors = torch.linalg.eigh(torch.from_numpy(np.array(strategy.C)))
    root = before @ (vectors * values.clamp_min(0).sqrt())
    return root / torch.linalg.matrix_norm(root, 2)
