"""A path refined as a whole: all of its frames at once, by smooth moves alone, so that it stays as steady as it was.

What is filtered ends beside the minima of its frames, and a frame cannot go back to its own without a jump. So the
moves of all frames are found together, by damped least squares from what the losses make of every frame and from what
the path bends by them: no loss sees that it shakes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..pipeline.objective import group_norms
from ..reading.tracks import along
from .spline import Local, bending, moved
from .whole_clip import WholeClip

WIDE = 0.1  # step of the differences, in the units of x: depths jump, and narrow ones only tell how they creep
ONCE = 0.02  # the same where there is one round, which has to tell of both
NARROWER, FAR_NARROWER = 0.5, 0.25  # what it is multiplied by for the next round: after a gain, and without one
MISSED = 2  # rounds without a gain, one after the other, that end it
SHARED = 7  # frames that measure all directions together: moves are smooth, and so is what they need
DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-2, 1e-3, 1e3
SOFTER, HARDER = 0.3, 10.0  # what the damping is multiplied by after a step that was taken, or was not
PROMISE = 0.002  # total, and bends, that the linear model has to promise
DOWNHILL = 0.1  # of the cost: a step that saves as much is followed by another, beyond those of the round
BLEND = 3.5  # [frames] over which a move fades out towards frames that lose by it


@dataclass(frozen=True)
class Effort:
    """How far a path is refined.

    Args:
        rounds: of differences, narrower each time; 0 refines nothing.
        steps: paths evaluated in a round, at most; more while each saves a tenth.
    """

    rounds: int
    steps: int

    @property
    def width(self) -> float:
        """Step of the first differences, in the units of x."""
        return WIDE if self.rounds > 1 else ONCE


@dataclass(frozen=True)
class Moves:
    """Moves that are tried.

    Args:
        knots: a dimension.
        fixed: direction (D,) of x along which nothing changes but for all frames alike; None leaves all free.
        fade: whether a move may fade out towards frames that lose by it; a static or linear path would not stay one.
        about: path (N, D) whose own bends cost nothing, because the reference makes them; None is a straight one.
        enough: mean total up to which a round that gains nothing is the last one.
    """

    knots: int
    fixed: Tensor | None
    fade: bool
    about: Tensor | None = None
    enough: float = math.inf


@dataclass(frozen=True)
class _At:
    x: Tensor  # (N, D)
    local: Local
    about: Tensor | None  # (N, D)
    at: Tensor | None  # (N,)

    @property
    def cost(self) -> float:
        return self.local.total + bending(self.x, self.about, self.at)

    @property
    def totals(self) -> Tensor:
        return group_norms(self.local.residuals, self.local.groups).sum(1)  # (N,)

    def reached(self, x: Tensor, residuals: Tensor) -> _At:
        """At x (N, D), with the Jacobians corrected by what that step has shown."""
        jacobian = broyden(self.local, x - self.x, residuals)
        return replace(self, x=x, local=replace(self.local, residuals=residuals, jacobian=jacobian))


def refine_path(clip: WholeClip, x: Tensor, residuals: Tensor, moves: Moves, effort: Effort) -> tuple[Tensor, Tensor]:
    """The path moved to where it costs less, and its residuals.

    The differences of a round take D / :data:`SHARED` evaluations a frame, each of its steps one more. What wide ones
    do not find downhill, because they reach across a bend, narrower ones may.

    Args:
        clip: what it is a path for; every loss has residuals.
        x: the path, (N, D).
        residuals: of it, (N, R).
        moves: that may be made.
        effort: rounds and steps.
    """
    width, missed = effort.width, 0
    for i in range(effort.rounds):
        begun = _At(x, clip.local(x, residuals, width, SHARED, i), moves.about, clip.at)
        at = _round(clip, begun, moves, effort.steps)
        x, residuals = at.x, at.local.residuals
        missed = 0 if at.cost <= begun.cost - PROMISE else missed + 1
        if missed and (missed == MISSED or at.local.total <= moves.enough):
            break
        width *= FAR_NARROWER if missed else NARROWER
    return x, residuals


def _round(clip: WholeClip, at: _At, moves: Moves, left: int) -> _At:
    damping, downhill = DAMPING, False
    while (left > 0 or downhill) and damping <= MOST_DAMPING:
        promised = moved(at.x, at.local, moves.knots, damping, moves.fixed, moves.about, clip.at)
        assert promised.predicted is not None
        if promised.predicted + bending(promised.x, moves.about, clip.at) > at.cost - PROMISE:
            break
        x = clip.inside(promised.x)
        there = at.reached(x, clip.residuals(x))
        left -= 1
        best = there
        if moves.fade and left > 0 and float((at.totals > there.totals).double().mean()) not in (0.0, 1.0):
            share = along((there.totals < at.totals).double()[:, None], BLEND, clip.at)
            x = clip.inside(faded(at.x, there.x, share, moves.fixed))
            part = at.reached(x, clip.residuals(x))
            left -= 1
            best = min(there, part, key=lambda a: a.cost)
        downhill = best.cost <= (1 - DOWNHILL) * at.cost
        if best.cost < at.cost:
            at, damping = best, max(SOFTER * damping, LEAST_DAMPING)
        else:
            at, damping = replace(at, local=replace(at.local, jacobian=there.local.jacobian)), HARDER * damping
    return at


def faded(x: Tensor, there: Tensor, share: Tensor, fixed: Tensor | None = None) -> Tensor:
    """From x to ``there`` (N, D) by a ``share`` (N, 1) of the way; along ``fixed`` (D,) the frames still move alike."""
    move = there - x
    if fixed is None:
        return x + share * move
    at = int(fixed.abs().argmax())
    alike = torch.zeros_like(move)
    alike[:, at] = move @ fixed / fixed[at]
    return x + alike + share * (move - alike)


def broyden(local: Local, move: Tensor, residuals: Tensor) -> Tensor:
    """Jacobians (N, R, D) changed as little as explains the ``residuals`` (N, R) seen after a ``move`` (N, D).

    A residual between two frames follows the difference of their moves.
    """
    before = torch.cat([torch.zeros_like(move[:1]), move[:-1]])
    step = move[:, None] - local.paired[None, :, None] * before[:, None]  # (N, R, D)
    missed = residuals - local.residuals - (local.jacobian * step).sum(-1)
    square = (step**2).sum(-1)
    return local.jacobian + torch.where(square > 1e-10, missed / square.clamp_min(1e-10), 0.0)[..., None] * step
