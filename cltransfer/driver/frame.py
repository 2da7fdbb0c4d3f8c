"""One frame: candidates scored, and the engines that search them. Every engine asks a batch and gets numbers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from ..pipeline.objective import Objective, group_norms
from .adam import descend
from .cma_es import Budget, Start, minimise
from .problem import Problem, distinct
from .refine import Refined, differences, flat_directions, inside, refine
from .retry import RENEWAL, RESCUE, Retry
from .schedule import Schedule

RESCUE_BUDGET = Budget(generations=25, patience=8, popsize=10)
RESCUE_SIGMA = 0.08
POLISH_SIGMA = 0.04
ROUGH = 0.02  # step of the differences that a polish is told by, in the units of x: losses are rough within less
BASIN = Budget(generations=40, patience=12, popsize=12)
TRIAL = 2  # steps with a new Jacobian that show whether it helps
STUCK = 0.1  # total below which an old one is not doubted, half a tolerance of one term
CARRIED = "carried"  # why a frame ended that was not searched, since nobody is seen in it
AS_BEFORE = "as before"  # since nothing moves
SAME = 1e-3  # by which residuals differ at most, that are taken for the same; 0.2 is one tolerance


@dataclass(frozen=True)
class Memory:
    """What one frame teaches the next.

    Args:
        shape: of CMA-ES's covariance, (D, D).
        jacobian: of the residuals, (R, D).
        known: residuals, (R,) bool, that some frame so far had.
        totals: of the frames so far that show somebody; where nobody is seen nothing is compared, and a total is low.
        renewal: of the Jacobian, where it is carried from frame to frame.
        settled: residuals (R,) that the last frame ended at and could not lower; None where it could.
        rescue: of frames that are refined, by CMA-ES.
    """

    shape: Tensor | None = None
    jacobian: Tensor | None = None
    known: Tensor | None = None
    totals: tuple[float, ...] = ()
    renewal: Retry = RENEWAL
    settled: Tensor | None = None
    rescue: Retry = RESCUE

    def nothing_new(self, residuals: Tensor) -> bool:
        """Whether a frame begins with the residuals (R,) that the last one could not lower: nothing moves."""
        return self.settled is not None and bool(((residuals - self.settled).abs() <= SAME).all())

    def placed(self, objective: Objective, schedule: Schedule) -> bool:
        """Whether a frame so far told where to stand, or none ever does; true too where no Jacobian is kept."""
        return self.known is None or not schedule.placed or bool((self.known & ~objective.paired).any())


@dataclass(frozen=True)
class Solved:
    """What was found for one frame.

    Args:
        x: (D,).
        total: there; where it was refined flow counts by half, as in :class:`~.refine.Refined`.
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

    A search that is recentred starts at 0, wherever the camera stands. Where no term of the frame counts, there is
    nothing to search for, and nothing is learned.
    """
    starts = distinct(_allowed(problem, starts, schedule))
    if schedule.engine != "refine" and not bool((problem.defined & problem.stage.objective.weighs).any()):
        return Solved(starts[0], 0.0, 0, CARRIED, memory)
    if schedule.engine == "cma":
        return _by_cma(problem, starts, memory, schedule, generator)
    if schedule.engine == "adam":
        return _by_adam(problem, starts, memory, schedule, generator)
    return _by_refinement(problem, starts, memory, schedule, generator)


def carried(problem: Problem, starts: Tensor, memory: Memory, schedule: Schedule) -> Solved:
    """The best of ``starts`` (S, D), which may lie beyond the bounds as in :func:`solve`, and no search from there.

    Where the person is hidden, it would only drift away.
    """
    starts = _allowed(problem, starts, schedule)
    totals = problem.totals(starts)
    best = int(totals.argmin())
    return Solved(starts[best], float(totals[best]), 0, CARRIED, memory)


def held(problem: Problem, x: Tensor, memory: Memory, schedule: Schedule) -> Solved:
    """A frame of a shot that stands still, as the last one ended, x (D,)."""
    if schedule.engine != "refine":
        return Solved(x, float(problem.totals(x[None])[0]), 0, AS_BEFORE, memory)
    return _Refining(problem, memory, schedule).as_before(x, problem.residuals(x[None])[0])


def _allowed(problem: Problem, starts: Tensor, schedule: Schedule) -> Tensor:
    recentred = schedule.engine == "adam" and hasattr(problem.search, "recentred")
    return starts if recentred else inside(starts, problem.bounds)


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
    several = len(starts) > 1 and (problem.before is None or not schedule.warm)
    x = starts[int(problem.totals(starts).argmin())] if several else starts[0]
    found = descend(problem, x, schedule.adam, generator)
    return Solved(found.x, found.total, found.steps, "iterations", Memory(totals=(*memory.totals, found.total)))


def _by_refinement(
    problem: Problem, starts: Tensor, memory: Memory, schedule: Schedule, generator: np.random.Generator
) -> Solved:
    frame = _Refining(problem, memory, schedule)
    if memory.jacobian is None or not memory.placed(problem.stage.objective, schedule):
        found, renewal = frame.first(starts), RENEWAL
        limit, sigma, budget = schedule.basin, schedule.sigma, BASIN
        if schedule.polish is not None and not memory.totals and found.total <= limit:
            limit, sigma, budget = schedule.refinement.tolerance, POLISH_SIGMA, schedule.polish
        poor = found.total > limit
    else:
        x, residuals = frame.best(starts)
        if memory.nothing_new(residuals) and not frame.far(frame.total(residuals)):
            return frame.as_before(x, residuals)
        found, renewal = frame.next(x, residuals)
        poor, sigma, budget = frame.far(found.total), RESCUE_SIGMA, RESCUE_BUDGET
    if not poor:
        return frame.solved(found, renewal, found.stop)
    shape = frame.flat(found) if budget is schedule.polish else None
    wide = minimise(problem.totals, Start(found.x, sigma, shape), problem.bounds, budget, generator)
    again = frame.refined(wide.x)
    if budget is RESCUE_BUDGET:
        frame.rescue = frame.rescue.done(found.total, again.total)
    if again.total < found.total:
        return frame.solved(again, renewal, f"rescued, {again.stop}", wide.generations)
    return frame.solved(found, renewal, found.stop, wide.generations)


class _Refining:
    """A frame that is refined: from every start, or from the best one with what the frames before it taught."""

    def __init__(self, problem: Problem, memory: Memory, schedule: Schedule) -> None:
        objective = problem.stage.objective
        if objective.groups is None:
            raise ValueError("refinement needs residuals of every loss; use engine=cma")
        self.problem, self.memory, self.schedule, self.groups = problem, memory, schedule, objective.groups
        self.rows = objective.rows(problem.defined)  # (R,)
        self.known = torch.zeros_like(self.rows) if memory.known is None else memory.known  # (R,)
        self.rescue = memory.rescue.next()

    @property
    def usual(self) -> float:
        """Total that the frames so far ended at; 0 where there is none."""
        return float(np.median(self.memory.totals or (0.0,)))

    def refined(
        self, x: Tensor, jacobian: Tensor | None = None, residuals: Tensor | None = None, steps: int | None = None
    ) -> Refined:
        """The minimum from x (D,); what is None is measured, or as the schedule has it."""
        options = self.schedule.refinement if steps is None else replace(self.schedule.refinement, steps=steps)
        return refine(self.problem.residuals, x, self.groups, options, jacobian, self.problem.bounds, residuals)

    def first(self, starts: Tensor) -> Refined:
        """A first frame: every start (S, D) may lie in another basin. Where nothing is known the first one does."""
        if not bool(self.rows.any()):
            nothing = torch.zeros_like(self.rows, dtype=starts.dtype)
            return Refined(starts[0], 0.0, nothing, nothing[:, None] * starts[0], "tolerance")
        return min((self.refined(x) for x in starts), key=lambda found: found.total)

    def flat(self, found: Refined) -> Tensor:
        """Along which directions little changes about what was ``found``, farther than losses are rough, (D, D)."""
        jacobian = differences(self.problem.residuals, found.x, found.residuals, self.problem.bounds, ROUGH)
        return flat_directions(jacobian, found.residuals, self.groups)

    def best(self, starts: Tensor) -> tuple[Tensor, Tensor]:
        """The best of ``starts`` (S, D) and its residuals, (D,) and (R,)."""
        residuals = self.problem.residuals(starts)
        best = int(group_norms(residuals, self.groups).sum(1).argmin())
        return starts[best], residuals[best]

    def next(self, x: Tensor, residuals: Tensor) -> tuple[Refined, Retry]:
        """A frame after others: from x (D,), which has ``residuals``, by their Jacobian where that does still."""
        assert self.memory.jacobian is not None
        # of flow Broyden's updates are enough, measured afresh it misleads
        new = bool((self.rows & ~self.known & ~self.problem.stage.objective.paired).any())
        renewal = self.memory.renewal.next()
        renewal = renewal.needless() if new else renewal
        carried = self.memory.jacobian * self.rows[:, None]
        found = self.refined(x, None if new else carried, residuals)
        if not new and torch.equal(found.x, x) and bool((self.rows & (carried == 0).all(1) & (residuals != 0)).any()):
            found = self.refined(x, None, residuals)  # no step was taken by which Broyden's update could begin
        if not (self.schedule.renewed and renewal.due(found.total, self.usual, STUCK)):
            return found, renewal
        before = found.total
        found = self.refined(found.x, None, found.residuals, TRIAL)
        if renewal.helped(before, found.total):
            found = self.refined(found.x, found.jacobian, found.residuals)
        return found, renewal.done(before, found.total)

    def far(self, total: float) -> bool:
        """Whether a frame after others, that ends at ``total``, is to be searched by CMA-ES."""
        return self.rescue.due(total, self.usual, self.schedule.rescue)

    def total(self, residuals: Tensor) -> float:
        """Total of residuals (R,)."""
        return float(group_norms(residuals[None], self.groups).sum())

    def as_before(self, x: Tensor, residuals: Tensor) -> Solved:
        """A frame that is not searched, because it begins as the last one ended."""
        total = self.total(residuals)
        memory = replace(self.memory, totals=(*self.memory.totals, total), rescue=self.rescue)
        return Solved(x, total, 0, AS_BEFORE, memory)

    def solved(self, found: Refined, renewal: Retry, stop: str, generations: int = 0) -> Solved:
        """What was found, and what it teaches the next frame."""
        totals, kept = (*self.memory.totals, found.total), self.memory.jacobian
        if not self.schedule.warm:
            return Solved(found.x, found.total, generations, stop, Memory(totals=totals))
        jacobian = found.jacobian if kept is None else torch.where(self.rows[:, None], found.jacobian, kept)
        settled = found.residuals if found.stop == "worth" else None
        memory = Memory(None, jacobian, self.known | self.rows, totals, renewal, settled, self.rescue)
        return Solved(found.x, found.total, generations, stop, memory)


def predictions(xs: list[Tensor], at: Tensor) -> Tensor:
    """The last frame, and the last motion continued, (1 or 2, D), of a clip whose frames stand ``at`` (N,)."""
    if len(xs) < 2:
        return xs[-1][None]
    before, last, now = at[len(xs) - 2 : len(xs) + 1].tolist()
    on = (now - last) / (last - before)
    return torch.stack([xs[-1], (1 + on) * xs[-1] - on * xs[-2]])
