"""Adam on a search's vector, by central differences: the optimiser of JAWS, as a baseline.

A step asks one batch of 2M + 1 candidates, M the numbers that move: no renderer has to be differentiable, and on
geometric features differences are exact. With two strokes, pose follows all losses and the lens those of the flow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from ..config.adam import AdamConfig
from .problem import Problem
from .refine import inside

BETAS = (0.9, 0.999)
DECAY = 0.8  # of the rate, from a frame's first step to its last
POSE_RATE, LENS_RATE = 1.2, 0.5  # of the rate, in two strokes
CLIP = 1e-3  # longest gradient; Adam takes its direction
SPREAD = 0.01  # of the start, so that the axis of a rotation by nothing has a gradient; JAWS: 1e-6, by autograd
BALANCE = 0.5  # alpha of GradNorm
LEAST_WEIGHT = 0.05
BALANCE_RATE = 0.025  # of GradNorm's weights; that of its paper


@dataclass(frozen=True)
class Descent:
    """The best of the recorded steps.

    Args:
        x: (D,).
        total: there, by the losses' own weights.
        steps: gradients taken.
    """

    x: Tensor  # (D,)
    total: float
    steps: int


@dataclass(frozen=True)
class Stroke:
    """A part of x that moves by a part of the terms.

    Args:
        moved: indices into x.
        terms: the terms that move it, (L,) bool.
        rate: its learning rate, as a share of the frame's.
    """

    moved: tuple[int, ...]
    terms: Tensor  # (L,)
    rate: float


def descend(problem: Problem, x: Tensor, options: AdamConfig, generator: np.random.Generator) -> Descent:
    """Descend from ``x`` (D,) and return the best recorded step.

    A search that can be recentred is, so that each frame starts about the camera of the last one (JAWS).
    """
    origin = problem
    if hasattr(problem.search, "recentred"):
        x, home = problem.search.recentred(x, problem.home)
        problem = replace(problem, home=home)
    noise = SPREAD * torch.from_numpy(generator.standard_normal(problem.search.dimensions - 1))
    x = x.double().clone()
    x[: len(noise)] += noise
    found = _descended(problem, x, options)
    if problem is origin:
        return found
    camera = problem.cameras(found.x[None])
    x = problem.search.vector(camera, origin.home, origin.stage.scene.subject)[0, : len(x)]
    return replace(found, x=x)


def _descended(problem: Problem, x: Tensor, options: AdamConfig) -> Descent:
    strokes = strokes_of(problem, options.strokes == "two")
    count = options.iterations if problem.before is not None else max(1, options.iterations // 2)
    adams = [Moments(len(stroke.moved)) for stroke in strokes]
    balance = GradNorm(int(strokes[0].terms.sum()), options.quirks) if options.weighting == "gradnorm" else None
    best, recorded, total, steps = x, float("inf"), float("inf"), 0
    for iteration in range(count):
        for number, stroke in enumerate(strokes):
            values, slopes = central_differences(problem.weighted, x, stroke.moved, options.difference)
            own, slopes = values[stroke.terms], slopes[stroke.terms]
            if balance is not None and (number == 0 or options.quirks):
                weights = balance.update(own, slopes) if number == 0 else balance.weights[stroke.terms]
                own, slopes = weights * own, weights[:, None] * slopes
            rivals = own if options.quirks else values
            if float(rivals.sum()) < recorded:
                best, recorded, total = x, float(rivals.sum()), float(values.sum())
            share = 1.0 if options.quirks and iteration > 0 else stroke.rate
            rate = options.rate * share * DECAY ** (iteration / count)
            x = _stepped(x, stroke.moved, rate * adams[number].direction(slopes.sum(0)), problem.bounds)
            steps += 1
    return Descent(best, total, steps)


def strokes_of(problem: Problem, two: bool) -> tuple[Stroke, ...]:
    """The strokes of one iteration: pose and lens, or one for all.

    A first frame has no flow, so everything moves by what can be seen in it; without any flow loss, or with a fixed
    lens, there is no second stroke.
    """
    objective = problem.stage.objective
    everything = tuple(range(problem.dimensions))
    all_terms = torch.ones(len(objective.losses), dtype=torch.bool)
    of_flow = objective.of_motion & problem.defined
    if not two or problem.before is None:
        return (Stroke(everything, all_terms, 1.0),)
    if not problem.free_lens:
        return (Stroke(everything, all_terms, POSE_RATE),)
    pose = Stroke(everything[:-1], all_terms, POSE_RATE)
    return (pose, Stroke(everything[-1:], of_flow, LENS_RATE)) if bool(of_flow.any()) else (pose,)


def central_differences(
    evaluate: Callable[[Tensor], Tensor], x: Tensor, moved: tuple[int, ...], step: float
) -> tuple[Tensor, Tensor]:
    """Terms (L,) at x (D,) and their derivatives (L, M) by the M numbers ``moved``, in one batch of 2M + 1.

    >>> central_differences(lambda x: x**2, torch.tensor([3.0, 1.0]).double(), (0,), 0.5)[1]
    tensor([[6.],
            [0.]], dtype=torch.float64)
    """
    steps = step * torch.eye(len(x), dtype=x.dtype)[list(moved)]
    values = evaluate(torch.cat([x[None], x + steps, x - steps]))
    ahead, behind = values[1 : 1 + len(moved)], values[1 + len(moved) :]
    return values[0], ((ahead - behind) / (2 * step)).T


class Moments:
    """Adam's running moments of M numbers."""

    def __init__(self, count: int) -> None:
        self.mean = torch.zeros(count, dtype=torch.float64)
        self.square = torch.zeros(count, dtype=torch.float64)
        self.steps = 0

    def direction(self, gradient: Tensor) -> Tensor:
        """What to add to x, (M,), at a learning rate of 1."""
        gradient = gradient * (CLIP / gradient.norm().clamp_min(CLIP))
        self.steps += 1
        self.mean = BETAS[0] * self.mean + (1 - BETAS[0]) * gradient
        self.square = BETAS[1] * self.square + (1 - BETAS[1]) * gradient**2
        mean, square = self.mean / (1 - BETAS[0] ** self.steps), self.square / (1 - BETAS[1] ** self.steps)
        return -mean / (square.sqrt() + 1e-8)


class GradNorm:
    """Weights of K terms that keep their gradients alike, faster for terms that have decreased less.

    A gradient is that by all M numbers that move; the published code of JAWS takes its first parameter's alone.
    They start at 1, add up to K and stay above :data:`LEAST_WEIGHT`. A term that is 0 at its first step, such as one
    that the reference lacks, has no ratio: it keeps the weight 1 and the others are balanced without it.

    Args:
        count: K.
        quirks: it is balanced too, as in the published code of JAWS: nothing moves as long as it is 0, and once it is
            not, its ratio is infinite and the weights of all others sink to the least.
    """

    def __init__(self, count: int, quirks: bool = False) -> None:
        self.weights = torch.ones(count, dtype=torch.float64)
        self.quirks = quirks
        self.first: Tensor | None = None

    def update(self, values: Tensor, slopes: Tensor) -> Tensor:
        """The next weights (K,), of the terms (K,) and their derivatives (K, M)."""
        self.first = values if self.first is None else self.first
        balanced = torch.ones_like(self.first, dtype=torch.bool) if self.quirks else self.first > 0
        ratio, norms, weights = (x[balanced] for x in (values / self.first, slopes.norm(dim=1), self.weights))
        weighted = weights * norms
        target = weighted.mean() * (ratio / ratio.mean()) ** BALANCE
        change = torch.sign(weighted - target) * norms / norms.mean()
        moved = (weights - BALANCE_RATE * change.nan_to_num(0)).clamp_min(LEAST_WEIGHT)
        self.weights = self.weights.masked_scatter(balanced, moved * len(moved) / moved.sum())
        return self.weights


def _stepped(x: Tensor, moved: tuple[int, ...], step: Tensor, bounds: tuple[Tensor, Tensor]) -> Tensor:
    """x (D,) with ``step`` (M,) added to the numbers ``moved``, inside ``bounds``."""
    x = x.clone()
    x[list(moved)] += step
    return inside(x, bounds)
