"""CMA-ES by ask and tell around pycma: our own random numbers, our own stop rules, one batch a generation."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

DECREASE = 1e-6  # relative; a smaller decrease of the best total does not count (mission gap 18)


@dataclass(frozen=True)
class Budget:
    """When one minimisation ends.

    Args:
        generations: at most.
        patience: generations without decrease of the best total.
        popsize: candidates a generation.
        tolerance: total that is good enough.
    """

    generations: int = 100
    patience: int = 20
    popsize: int = 10
    tolerance: float = 0.0


@dataclass(frozen=True)
class Minimum:
    """The best candidate and what it cost.

    Args:
        x: best vector, (D,) float64.
        total: its total.
        evaluations: candidates evaluated, the start included.
        generations: asked and told.
        stop: tolerance, patience or generations.
    """

    x: Tensor  # (D,)
    total: float
    evaluations: int
    generations: int
    stop: str


def minimise(
    evaluate: Callable[[Tensor], Tensor],
    start: Tensor,
    sigma: float,
    bounds: tuple[Tensor, Tensor],
    budget: Budget,
    generator: np.random.Generator,
) -> Minimum:
    """Minimise ``evaluate`` from ``start`` by CMA-ES (paper Sec. 4.3).

    pycma's own stop rules are off, because a flat fitness would stop it at generation 0; its random numbers come from
    ``generator``, so no global seed is touched. The start itself is evaluated: the result is never worse than it.

    Args:
        evaluate: totals (B,) of x (B, D), finite.
        start: (D,) float64.
        sigma: first step size, in the units of x.
        bounds: lowest and highest x, (D,) each; infinite where free.
        budget: when to stop.
        generator: source of every random number.
    """
    import cma

    low, high = bounds
    options = {
        "verbose": -9,
        "seed": math.nan,  # pycma then leaves numpy's global state alone
        "randn": lambda *shape: generator.standard_normal(shape),
        "popsize": budget.popsize,
        "bounds": [_open(low), _open(high)],
    }
    inside = torch.minimum(torch.maximum(start.double(), low + 1e-9), high - 1e-9)
    strategy = cma.CMAEvolutionStrategy(inside.numpy(), sigma, options)
    best, total = inside, float(evaluate(inside[None])[0])
    evaluations, waited, generation, stop = 1, 0, 0, "generations"
    while generation < budget.generations:
        if total <= budget.tolerance:
            stop = "tolerance"
            break
        if waited >= budget.patience:
            stop = "patience"
            break
        asked = strategy.ask()
        x = torch.from_numpy(np.stack(asked))
        totals = evaluate(x)
        strategy.tell(asked, totals.tolist())
        evaluations, generation, waited = evaluations + len(x), generation + 1, waited + 1
        index = int(totals.argmin())
        if float(totals[index]) < total - DECREASE * abs(total):
            waited = 0
        if float(totals[index]) < total:
            best, total = x[index], float(totals[index])
    return Minimum(best, total, evaluations, generation, stop)


def _open(limit: Tensor) -> list[float | None]:
    return [value if math.isfinite(value) else None for value in limit.tolist()]
