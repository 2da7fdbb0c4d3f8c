"""A path refined as a whole: all of its frames at once, by smooth moves alone, so that it stays as steady as it was.

What is filtered ends beside the minima of its frames, and a frame cannot go back to its own without a jump. So the
moves of all frames are found together, by damped least squares from what the losses make of every frame and from what
the path bends by them: no loss sees that it shakes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

from ..along_clip import along
from ..pipeline.objective import group_norms
from .jumps import WORTH, Jumps, jumps_of
from .spline import Local, bending, moved
from .whole_clip import WholeClip

WIDE = 0.1  # step of the differences, in the units of x: depths jump, and narrow ones only tell how they creep
ONCE = 0.02  # the same where there is one round, which has to tell of both
NARROWER, FAR_NARROWER = 0.5, 0.25  # what it is multiplied by for the next round: after a gain, and without one
MISSED = 2  # rounds without a gain, one after the other, that end it
SHARED = 7  # frames that measure all directions together: moves are smooth, and so is what they need
DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-2, 1e-3, 1e3
LED_DAMPING = 0.1  # the first one across jumps
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
    clip: WholeClip
    moves: Moves
    x: Tensor  # (N, D)
    measured: Local  # of the residuals, and of jumps where there are some
    jumps: Jumps | None = None

    @cached_property
    def local(self) -> Local:
        """Residuals that steps follow, led ones replaced."""
        return self.measured if self.jumps is None else self.jumps.local(self.measured)

    @cached_property
    def cost(self) -> float:
        """Their total and bends."""
        return self.local.total + self._bends(self.x)

    @property
    def residuals(self) -> Tensor:
        """The losses' own residuals, (N, R)."""
        return self.measured.residuals[:, : len(self.measured.groups)]

    @cached_property
    def true_cost(self) -> float:
        """Total of those, and bends."""
        return self.clip.mean_total(self.residuals) + self._bends(self.x)

    @property
    def totals(self) -> Tensor:
        return group_norms(self.local.residuals, self.local.groups).sum(1)  # (N,)

    def promised(self, damping: float) -> tuple[Tensor, float]:
        """Where the model leads, (N, D), and its cost there."""
        moves, clip = self.moves, self.clip
        found = moved(self.x, self.local, moves.knots, damping, moves.fixed, moves.about, clip.at)
        assert found.predicted is not None
        return found.x, found.predicted + self._bends(found.x)

    def reached(self, x: Tensor) -> _At:
        """At x (N, D), with the Jacobians corrected by what that step shows."""
        x = self.clip.inside(x, self.moves.fixed)
        there = self.clip.residuals(x) if self.jumps is None else self.jumps.values(self.clip.across(x))
        jacobian = broyden(self.measured, x - self.x, there)
        return replace(self, x=x, measured=replace(self.measured, residuals=there, jacobian=jacobian))

    def led(self) -> _At:
        """Across those jumps alone that the model brings near; across none where they are not worth it."""
        at = self
        while at.jumps is not None:
            jumps = at.jumps.crossed(at.measured, at.promised(LED_DAMPING)[0] - at.x)
            if jumps.worth < WORTH:
                return replace(at, measured=at.jumps.own(at.measured), jumps=None)
            if torch.equal(jumps.led, at.jumps.led):
                break
            at = replace(at, jumps=jumps)
        return at

    def _bends(self, x: Tensor) -> float:
        return bending(x, self.moves.about, self.clip.at)


def refine_path(clip: WholeClip, x: Tensor, residuals: Tensor, moves: Moves, effort: Effort) -> tuple[Tensor, Tensor]:
    """The path moved to where it costs less, and its residuals.

    The differences of a round take D / :data:`SHARED` evaluations a frame, each of its steps one more. What wide ones
    do not find downhill, because they reach across a bend, narrower ones may. Where a loss jumps, frames are led across
    (:mod:`~.jumps`); of all paths on the way the one that costs least is taken.

    Args:
        clip: what it is a path for; every loss has residuals.
        x: the path, (N, D).
        residuals: of it, (N, R).
        moves: that may be made.
        effort: rounds and steps.
    """
    width, missed, tried = effort.width, 0, torch.zeros_like(residuals, dtype=torch.bool)
    for i in range(effort.rounds):
        begun = _begun(clip, x, residuals, moves, width, i, tried)
        if begun.jumps is not None:
            tried[:, begun.jumps.columns] |= begun.jumps.led
        best = _round(begun, effort.steps)
        x, residuals = best.x, best.residuals
        missed = 0 if best.true_cost <= begun.true_cost - PROMISE else missed + 1
        if missed and (missed == MISSED or clip.mean_total(residuals) <= moves.enough):
            break
        width *= FAR_NARROWER if missed else NARROWER
    return x, residuals


def _begun(clip: WholeClip, x: Tensor, residuals: Tensor, moves: Moves, width: float, first: int, tried: Tensor) -> _At:
    across = clip.across(x, seen=True)
    jumps = jumps_of(across, tried)
    if jumps is not None:
        at = _At(clip, moves, x, clip.local(x, jumps.values(across), ONCE, SHARED, first, jumps), jumps).led()
        if at.jumps is not None or width == ONCE:
            return at
    return _At(clip, moves, x, clip.local(x, residuals, width, SHARED, first))


def _round(at: _At, left: int) -> _At:
    """The path that costs least of all on the way."""
    damping, downhill, best = LED_DAMPING if at.jumps else DAMPING, False, at
    fades = at.moves.fade and at.jumps is None  # to be across is worth more
    while (left > 0 or downhill) and damping <= MOST_DAMPING:
        x, promised = at.promised(damping)
        if promised > at.cost - PROMISE:
            break
        there = nearest = at.reached(x)
        left -= 1
        if fades and left > 0 and float((at.totals > there.totals).double().mean()) not in (0.0, 1.0):
            part = at.reached(faded(at.x, there.x, there.totals < at.totals, at.clip.at, at.moves.fixed))
            left -= 1
            nearest = min(there, part, key=lambda a: a.cost)
        best = min(best, nearest, key=lambda a: a.true_cost)
        downhill = at.jumps is None and nearest.cost <= (1 - DOWNHILL) * at.cost
        if nearest.cost < at.cost:
            jumps = None if at.jumps is None else at.jumps.nearer(nearest.measured)
            at, damping = replace(nearest, jumps=jumps), max(SOFTER * damping, LEAST_DAMPING)
        else:
            measured = replace(at.measured, jacobian=there.measured.jacobian)
            at, damping = replace(at, measured=measured), HARDER * damping
    return best


def faded(x: Tensor, there: Tensor, gains: Tensor, at: Tensor | None = None, fixed: Tensor | None = None) -> Tensor:
    """From x to ``there`` (N, D) where frames gain by it, (N,) bool, fading out towards those that lose.

    Args:
        x: the path, (N, D).
        there: where it would go, (N, D).
        gains: which frames gain there, (N,) bool.
        at: places of the frames, (N,); None are evenly spaced.
        fixed: direction (D,) along which all frames still move alike; None is none.
    """
    share = along(gains.double()[:, None], BLEND, at).clamp(0, 1)  # a line is fitted, which goes on beyond either
    move = there - x
    if fixed is None:
        return x + share * move
    column = int(fixed.abs().argmax())
    alike = torch.zeros_like(move)
    alike[:, column] = move @ fixed / fixed[column]
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
