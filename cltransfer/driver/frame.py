"""One frame: candidates scored, and the engines that search them. Every engine asks a batch and gets numbers."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..camera import Camera
from ..features import Features
from ..objective import Objective, group_norms
from .adam import descend
from .cma_es import Budget, Start, minimise
from .refine import Refined, Refinement, refine
from .renewal import TRIAL, WORSE, Renewal, helped
from .schedule import Schedule
from .stage import Stage

RESCUE = Budget(generations=25, patience=8, popsize=10)
RESCUE_SIGMA = 0.08
BASIN = Budget(generations=40, patience=12, popsize=12)
MOTION = 0.5  # of its weight that flow keeps while frames are refined one by one: where the last one erred, it misleads


@dataclass(frozen=True)
class Problem:
    """One reference frame, and how a vector is scored against it.

    Args:
        stage: renders and scores.
        search: vectors to cameras.
        home: the initial view.
        reference: the frame.
        before: features of the frame before as it was found, None for the first.
        defined: which terms the reference has, (L,) bool.
        free_lens: whether x holds the lens.
    """

    stage: Stage
    search: Any
    home: Camera
    reference: Features
    before: Features | None
    defined: Tensor  # (L,)
    free_lens: bool

    @property
    def dimensions(self) -> int:
        """D."""
        return self.search.dimensions if self.free_lens else self.search.dimensions - 1

    @property
    def bounds(self) -> tuple[Tensor, Tensor]:
        """Lowest and highest x, (D,) each."""
        low, high = self.search.bounds()
        return low[: self.dimensions], high[: self.dimensions]

    def cameras(self, x: Tensor) -> Camera:
        """B cameras of x (B, D)."""
        return self.search.cameras(x, self.home, self.stage.scene.subject)

    def totals(self, x: Tensor) -> Tensor:
        """Totals (B,) of x (B, D)."""
        return self.weighted(x).sum(dim=1)

    def weighted(self, x: Tensor) -> Tensor:
        """Weighted terms (B, L) of x (B, D), undefined ones priced; they add up to the totals."""
        terms = self.stage.terms(self.reference, self.cameras(x), self.before)
        return self.stage.objective.weighted(terms, self.defined)

    def residuals(self, x: Tensor) -> Tensor:
        """Residuals (B, R) of x (B, D) as one frame is refined by them: weighted, flow by :data:`MOTION` less."""
        residuals = self.stage.residuals(self.reference, self.cameras(x), self.before, self.defined)
        return residuals * motion_scale(self.stage.objective.paired)

    def aimed(self, x: Tensor) -> Tensor:
        """x (B, D) moved so that the subject stands where the reference has it, where the search can tell."""
        if not hasattr(self.search, "aimed") or not self.reference.has("keypoints"):
            return x[:0]
        return self.search.aimed(x, self.home, self.stage.scene.subject, self.reference)


@dataclass(frozen=True)
class Memory:
    """What one frame teaches the next.

    Args:
        shape: of CMA-ES's covariance, (D, D).
        jacobian: of the residuals, (R, D).
        known: residuals whose Jacobian was measured in some frame so far, (R,) bool.
        totals: of the frames so far.
        renewal: of the Jacobian, where it is carried from frame to frame.
    """

    shape: Tensor | None = None
    jacobian: Tensor | None = None
    known: Tensor | None = None
    totals: tuple[float, ...] = field(default=())
    renewal: Renewal = field(default_factory=Renewal)

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
    """Search one frame from ``starts`` (S, D), moved onto the bounds where they lie beyond."""
    low, high = problem.bounds
    starts = torch.minimum(torch.maximum(starts, low), high)
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
        new = rows & ~known & ~objective.paired  # of flow Broyden's updates are enough, measured afresh it misleads
        found = refined(starts[best], None if bool(new.any()) else kept * rows[:, None], residuals[best])
        if schedule.renewed and renewal.due(found.total, usual):
            before = found.total
            found = refined(found.x, None, found.residuals, replace(schedule.refinement, steps=TRIAL))
            if helped(before, found.total):
                found = refined(found.x, found.jacobian, found.residuals)
            renewal = renewal.done(before, found.total)
        limit, sigma, budget = max(schedule.rescue, WORSE * usual), RESCUE_SIGMA, RESCUE
    x, total, jacobian, stop, generations = found.x, found.total, found.jacobian, found.stop, 0
    if total > limit:
        wide = minimise(problem.totals, Start(x, sigma), problem.bounds, budget, generator)
        again = refined(wide.x, None)
        generations = wide.generations
        if again.total < total:
            x, total, jacobian, stop = again.x, again.total, again.jacobian, f"rescued, {again.stop}"
    if not schedule.warm:
        return Solved(x, total, generations, stop, Memory(totals=(*memory.totals, total)))
    jacobian = jacobian if kept is None else torch.where(rows[:, None], jacobian, kept)
    learned = Memory(None, jacobian, known | rows, (*memory.totals, total), renewal)
    return Solved(x, total, generations, stop, learned)


def motion_scale(paired: Tensor) -> Tensor:
    """What each residual (R,) is scaled by while frames are refined one by one."""
    return torch.where(paired, MOTION, 1.0).double()


def predictions(xs: list[Tensor]) -> Tensor:
    """The last frame, and the last motion continued, (1 or 2, D)."""
    if len(xs) < 2:
        return xs[-1][None]
    return torch.stack([xs[-1], 2 * xs[-1] - xs[-2]])
