"""One frame: candidates scored, and the engines that search them. Every engine asks a batch and gets numbers."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import torch
from torch import Tensor

from ..objective import Objective, group_norms
from .adam import descend
from .cma_es import Budget, Start, minimise
from .problem import Problem
from .refine import Refined, Refinement, refine
from .renewal import TRIAL, WORSE, Renewal, helped
from .schedule import Schedule

RESCUE = Budget(generations=25, patience=8, popsize=10)
RESCUE_SIGMA = 0.08
BASIN = Budget(generations=40, patience=12, popsize=12)
EQUAL = 1e-6  # by which two starts differ at most that are one, in the units of x
SAME = 1e-3  # by which residuals differ at most, that are taken for the same; 0.2 is one tolerance


@dataclass(frozen=True)
class Memory:
    """What one frame teaches the next.

    Args:
        shape: of CMA-ES's covariance, (D, D).
        jacobian: of the residuals, (R, D).
        known: residuals, (R,) bool, that some frame so far had.
        totals: of the frames so far.
        renewal: of the Jacobian, where it is carried from frame to frame.
        settled: residuals (R,) that the last frame ended at and could not lower; None where it could.
    """

    shape: Tensor | None = None
    jacobian: Tensor | None = None
    known: Tensor | None = None
    totals: tuple[float, ...] = field(default=())
    renewal: Renewal = field(default_factory=Renewal)
    settled: Tensor | None = None

    def nothing_new(self, residuals: Tensor) -> bool:
        """Whether a frame begins with the residuals (R,) that the last one could not lower: nothing moves."""
        return self.settled is not None and bool(((residuals - self.settled).abs() <= SAME).all())

    def placed(self, objective: Objective) -> bool:
        """Whether a frame so far told where to stand; flow alone does not. True where no Jacobian is kept."""
        return self.known is None or bool((self.known & ~objective.paired).any())


@dataclass(frozen=True)
class Solved:
    """What was found for one frame.

    Args:
        x: (D,).
        total: there.
        generations: of CMA-ES, or gradient steps of Adam.
        stop: why it ended.
        memory: for the next frame.
    """

    x: Tensor  # (D,)
    total: float
    generations: int
    stop: str
    memory: Memory


def solve(
    problem: Problem, starts: Tensor, memory: Memory, schedule: Schedule, generator: np.random.Generator
) -> Solved:
    """Search one frame from ``starts`` (S, D), moved onto the bounds where they lie beyond; from equal ones once.

    A search that is recentred starts at 0, wherever the camera stands.
    """
    low, high = problem.bounds
    if schedule.engine != "adam" or not hasattr(problem.search, "recentred"):
        starts = torch.minimum(torch.maximum(starts, low), high)
    starts = distinct(starts)
    if schedule.engine == "cma":
        return _by_cma(problem, starts, memory, schedule, generator)
    if schedule.engine == "adam":
        return _by_adam(problem, starts, memory, schedule, generator)
    return _by_refinement(problem, starts, memory, schedule, generator)


def carried(problem: Problem, starts: Tensor, memory: Memory) -> Solved:
    """The best of ``starts`` (S, D) as it is: where the person is hidden, a search would only drift away."""
    totals = problem.totals(starts)
    best = int(totals.argmin())
    return Solved(starts[best], float(totals[best]), 0, "carried", memory)


def _by_cma(
    problem: Problem, starts: Tensor, memory: Memory, schedule: Schedule, generator: np.random.Generator
) -> Solved:
    warm = memory.shape is not None
    x = starts[int(problem.totals(starts).argmin())] if len(starts) > 1 else starts[0]
    start = Start(x, schedule.warm_sigma if warm else schedule.sigma, memory.shape)
    found = minimise(problem.totals, start, problem.bounds, schedule.budget, generator)
    learned = Memory(found.shape if schedule.warm else None, totals=(*memory.totals, found.total))
    return Solved(found.x, found.total, found.generations, found.stop, learned)


def _by_adam(
    problem: Problem, starts: Tensor, memory: Memory, schedule: Schedule, generator: np.random.Generator
) -> Solved:
    x = starts[int(problem.totals(starts).argmin())] if problem.before is None and len(starts) > 1 else starts[0]
    found = descend(problem, x, schedule.adam, generator)
    return Solved(found.x, found.total, found.steps, "iterations", Memory(totals=(*memory.totals, found.total)))


def _by_refinement(
    problem: Problem, starts: Tensor, memory: Memory, schedule: Schedule, generator: np.random.Generator
) -> Solved:
    objective = problem.stage.objective
    groups, rows = objective.groups, objective.rows(problem.defined)
    if groups is None:
        raise ValueError("refinement needs residuals of every loss; use engine=cma")
    known = torch.zeros_like(rows) if memory.known is None else memory.known
    kept, renewal = memory.jacobian, memory.renewal.next()

    def refined(
        x: Tensor, jacobian: Tensor | None, residuals: Tensor | None = None, options: Refinement = schedule.refinement
    ) -> Refined:
        return refine(problem.residuals, x, groups, options, jacobian, problem.bounds, residuals)

    if kept is None or not memory.placed(objective):  # a first frame: every start may lie in another basin
        found, renewal = min((refined(x, None) for x in starts), key=lambda r: r.total), Renewal()
        limit, sigma, budget = schedule.basin, schedule.sigma, BASIN
    else:
        residuals, usual = problem.residuals(starts), float(np.median(memory.totals))
        best = int(group_norms(residuals, groups).sum(1).argmin())
        if memory.nothing_new(residuals[best]):
            total = float(group_norms(residuals[best : best + 1], groups).sum())
            return Solved(starts[best], total, 0, "as before", replace(memory, totals=(*memory.totals, total)))
        # of flow Broyden's updates are enough, measured afresh it misleads
        new = bool((rows & ~known & ~objective.paired).any())
        renewal = renewal.measured() if new else renewal
        found = refined(starts[best], None if new else kept * rows[:, None], residuals[best])
        if schedule.renewed and renewal.due(found.total, usual):
            before = found.total
            found = refined(found.x, None, found.residuals, replace(schedule.refinement, steps=TRIAL))
            if helped(before, found.total):
                found = refined(found.x, found.jacobian, found.residuals)
            renewal = renewal.done(before, found.total)
        limit, sigma, budget = max(schedule.rescue, WORSE * usual), RESCUE_SIGMA, RESCUE
    stop, generations = found.stop, 0
    if found.total > limit:
        wide = minimise(problem.totals, Start(found.x, sigma), problem.bounds, budget, generator)
        again = refined(wide.x, None)
        generations = wide.generations
        if again.total < found.total:
            found, stop = again, f"rescued, {again.stop}"
    totals = (*memory.totals, found.total)
    if not schedule.warm:
        return Solved(found.x, found.total, generations, stop, Memory(totals=totals))
    jacobian = found.jacobian if kept is None else torch.where(rows[:, None], found.jacobian, kept)
    settled = found.residuals if found.stop == "worth" else None
    return Solved(
        found.x, found.total, generations, stop, Memory(None, jacobian, known | rows, totals, renewal, settled)
    )


def distinct(starts: Tensor) -> Tensor:
    """The ``starts`` (S, D) that differ from all before them, in their order.

    >>> distinct(torch.tensor([[1.0, 2.0], [0.0, 2.0], [1.0, 2.0]]))
    tensor([[1., 2.],
            [0., 2.]])
    """
    equal = torch.isclose(starts[:, None], starts, rtol=0.0, atol=EQUAL).all(-1)  # (S, S)
    return starts[~equal.tril(-1).any(1)]


def predictions(xs: list[Tensor]) -> Tensor:
    """The last frame, and the last motion continued, (1 or 2, D)."""
    if len(xs) < 2:
        return xs[-1][None]
    return torch.stack([xs[-1], 2 * xs[-1] - xs[-2]])
