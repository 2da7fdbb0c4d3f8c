"""Along the clip: one search a frame, started from the frames before it or from the initial view."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from statistics import fmean

import numpy as np
import torch
from torch import Tensor

from ..along_clip import counted
from ..camera import Camera
from ..pipeline.objective import Objective
from .frame import CARRIED, Memory, Schedule, Solved, carried, held, predictions, solve
from .problem import Problem, motion_scale
from .spline import Local
from .view import View
from .whole_clip import WholeClip

GOOD = 0.3  # total of a frame that is about right
DRIFT, DRIFT_FLOOR = 9.0, 0.3  # times the first frames' total, and so much, that the last frames may end above it
LEAP, LEAP_FLOOR = 6.0, 3.0  # times the median, and at least so much, that no frame may end above


@dataclass(frozen=True)
class Path:
    """What was found.

    Args:
        x: (N, D) vectors of the search.
        camera: N cameras.
        frames: what was found for each frame.
        local: what the losses make of it; None where it was not refined by residuals.
    """

    x: Tensor  # (N, D)
    camera: Camera
    frames: tuple[Solved, ...]
    local: Local | None = None

    @property
    def totals(self) -> Tensor:
        """Total that each frame ended at, (N,)."""
        return torch.tensor([solved.total for solved in self.frames], dtype=torch.float64)

    @property
    def drifts(self) -> bool:
        """Whether the last third of the frames ended far worse than the first: each built on the one before."""
        totals = self._told(self.totals)
        third = max(1, len(totals) // 3)
        return len(totals) > 0 and fmean(totals[-third:]) > DRIFT * fmean(totals[:third]) + DRIFT_FLOOR

    def leaps(self, totals: Tensor) -> bool:
        """Whether a frame costs far more than the others: they are as they should be, and it was lost.

        Args:
            totals: what each frame costs, (N,): as it ended, or on a path through them.
        """
        return max(self._told(totals), default=0.0) > max(LEAP_FLOOR, LEAP * float(totals.median()))

    def _told(self, totals: Tensor) -> list[float]:
        """Totals (N,) but where nobody is seen, and in the frame after, whose flow is from there: none does better."""
        sought = [solved.stop != CARRIED for solved in self.frames]
        return [float(totals[i]) for i in range(len(totals)) if sought[i] and sought[max(i - 1, 0)]]


def follow(
    clip: WholeClip,
    homes: Camera,
    schedule: Schedule,
    progress: Callable[[int, Solved], None] = lambda frame, found: None,
    guide: Tensor | None = None,
) -> Path:
    """Find a camera for every frame of ``clip``, in order.

    Sequential because flow spans a frame and the one before (paper Sec. 9). A warm frame starts where a guide leads, or
    else the last frames or the reference's joints, and with what the last one learned of the landscape: neighbours have
    nearly the same. Each frame has its own random numbers, derived from the seed and its index.

    Args:
        clip: N frames, and what renders and scores candidates.
        homes: initial views, the best first; the first frame starts from the best of them.
        schedule: engine, budgets and starts.
        progress: called after each frame.
        guide: a path (N, D) that every frame may start from too, None where there is none.
    """
    stage, search, reference, home, defined = clip.stage, clip.search, clip.reference, clip.home, clip.defined
    subject = stage.scene.subject
    hidden = _hidden(stage.objective, defined)
    D = search.dimensions if schedule.free_lens else search.dimensions - 1
    at_home = search.vector(homes, home, subject)[:, :D]
    if guide is not None and hasattr(search, "turned"):
        at_home = search.turned(at_home, guide[0])  # a whole turn away it would be another motion from there
    beginnings = _Beginnings(at_home, guide, hidden, counted(len(reference), clip.at), schedule)
    found: list[Solved] = []
    residuals: list[Tensor] = []
    before: View | None = None
    memory = Memory()
    for i in range(len(reference)):
        problem = Problem(stage, search, home, reference[i], before, defined[i], schedule.free_lens)
        starts = beginnings.of(i, problem, found, memory)
        if schedule.still and schedule.engine != "adam" and schedule.warm and not hidden[:i].all():
            solved = held(problem, found[-1].x, memory, schedule)
        elif hidden[i] and found and schedule.warm:
            solved = carried(problem, starts, memory, schedule)
        else:
            generator = np.random.Generator(np.random.PCG64([schedule.seed, i]))
            solved = solve(problem, starts, memory, schedule, generator)
        stage.spent.generations += solved.generations
        memory = replace(solved.memory, totals=memory.totals) if hidden[i] else solved.memory
        found.append(solved)
        camera = problem.cameras(solved.x[None])
        stage = stage.about(camera)
        before = stage.view(camera, before)
        if schedule.engine == "refine":
            residuals.append(stage.told(reference[i], before, defined[i])[0])
        if stage.working is not None:
            before.settle()  # or it would hold the scene as it was merged for this frame
        progress(i, solved)
    x = torch.stack([solved.x for solved in found])
    local = _local(stage.objective, found, residuals, defined)
    return Path(x, search.cameras(x, home, subject), tuple(found), local)


@dataclass(frozen=True)
class _Beginnings:
    """What each of N frames starts from.

    Args:
        at_home: the initial views, (B, D).
        guide: a path (N, D), None where there is none.
        hidden: frames of which nothing is known of the joints, (N,) bool.
        at: places of the frames along the clip, (N,).
        schedule: whether frames start from those before.
    """

    at_home: Tensor  # (B, D)
    guide: Tensor | None  # (N, D)
    hidden: Tensor  # (N,)
    at: Tensor  # (N,)
    schedule: Schedule

    def of(self, i: int, problem: Problem, found: list[Solved], memory: Memory) -> Tensor:
        """Starts (S, D) of frame ``i``: the guide's, those that the ``found`` frames before lead to, or all at home."""
        guide, schedule = self.guide, self.schedule
        if not schedule.warm:
            return self.at_home
        if guide is not None and self.hidden[: max(1, i)].all():  # nothing known yet tells where to stand
            starts = torch.cat([guide[i][None], self.at_home])
        elif i > 0 and not self.hidden[:i].all() and memory.placed(problem.stage.objective, schedule):
            starts = self._onwards(i, problem, found)
        else:
            starts = self.at_home
        if self.hidden[i] and found and guide is not None:
            starts = torch.cat([starts, _beside(guide, i, found)[None]])
        return starts

    def _onwards(self, i: int, problem: Problem, found: list[Solved]) -> Tensor:
        """Starts (S, D) of a frame ``i`` that goes on from those before."""
        if self.guide is None or self.hidden[i]:
            starts = predictions([solved.x for solved in found], self.at)
            return torch.cat([starts, problem.aimed(starts[-1:])])
        starts = torch.stack([self.guide[i], _beside(self.guide, i, found)])
        if self.schedule.thorough and found[-1].total < GOOD:  # its own motion may go on too, lest the guide leaps
            starts = torch.cat([starts, predictions([solved.x for solved in found], self.at)[-1:]])
        return starts


def _beside(guide: Tensor, i: int, found: list[Solved]) -> Tensor:
    """Where frame ``i`` is, (D,), if it moves from the last one that was ``found`` as the ``guide`` (N, D) does."""
    return found[-1].x + guide[i] - guide[i - 1]


def _local(objective: Objective, found: list[Solved], residuals: list[Tensor], defined: Tensor) -> Local | None:
    jacobians = [solved.memory.jacobian for solved in found if solved.memory.jacobian is not None]
    if not residuals or objective.groups is None or len(jacobians) < len(found):
        return None
    rows = torch.stack([objective.rows(frame) for frame in defined])  # (N, R)
    jacobian = torch.stack(jacobians) * rows[..., None] / motion_scale(objective.paired)[:, None]
    return Local(torch.stack(residuals), jacobian, objective.groups, objective.paired)


def _hidden(objective: Objective, defined: Tensor) -> Tensor:
    """Frames (N,) in which nothing is known of the joints, of a clip that shows them elsewhere."""
    placing = torch.tensor(["keypoints" in loss.requires for loss in objective.losses.values()])
    seen = (defined & placing & objective.weighs).any(1)
    return ~seen & seen.any()
