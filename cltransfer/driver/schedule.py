"""How frames are searched: engine, budgets, and what the reference leaves to be searched at all."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import torch

from ..config.adam import AdamConfig
from ..config.options import RunConfig
from ..features import Features
from ..losses.filmic_space import counted
from ..pipeline.objective import Objective
from ..search.subject_orbit import SubjectOrbit
from .cma_es import Budget
from .refine import Refinement

LEAN_STEPS = 5  # at most
QUIET = 0.5  # of the noise: what is below it is not optimised
POLISH = Budget(generations=25, patience=8, popsize=10)
TWICE = 2  # times as many generations where paths are refined in more than one round: a still one has none to refine
UNGUIDED = "guide left out: of the searches only subject_orbit takes a path in closed form"
DAMPINGS = {1: (3e-2,), 2: (1e-2, 1.0), 3: (1e-3, 3e-2, 1.0)}


@dataclass(frozen=True)
class Schedule:
    """How frames are searched.

    Args:
        engine: of each frame: refine (least squares, rescued by CMA-ES), cma (alone) or adam.
        budget: of CMA-ES, each frame.
        refinement: of least squares, each frame.
        adam: of gradient descent, each frame.
        sigma: first step size of CMA-ES from the initial view, in the units of x.
        warm_sigma: the same from the frames before.
        warm: start from the frames before; otherwise every frame starts from the initial view.
        basin: total of the first frame above which CMA-ES looks for a better basin from there.
        rescue: total above which a later frame that is refined is searched by CMA-ES too, if it is also above
            four times the median of those before it; ever less often where it does not help (:mod:`~.retry`).
        renewed: whether a Jacobian carried along the clip is measured afresh where a frame ends far worse than usual.
        lean_limit: mean total up to which a clip followed leanly is good enough; 0 follows none leanly.
        free_lens: whether the focal length moves.
        placed: whether some frame tells where to stand; flow alone does not, then each goes on from the one before.
        polish: of CMA-ES, of a first frame that stands for all since nothing moves in the reference; else None.
        seed: of the run.
        note: why the engine is not the one asked for, or why no path in closed form guides it; empty where neither is.
    """

    engine: str
    budget: Budget
    refinement: Refinement
    adam: AdamConfig
    sigma: float
    warm_sigma: float
    warm: bool
    basin: float
    rescue: float
    renewed: bool
    lean_limit: float
    free_lens: bool
    placed: bool
    polish: Budget | None
    seed: int
    note: str = ""

    @property
    def still(self) -> bool:
        """Whether nothing moves in the reference."""
        return self.polish is not None

    @property
    def thorough(self) -> bool:
        """Whether several dampings are tried together, and starts with them."""
        return len(self.refinement.dampings) > 1

    @property
    def lean(self) -> Schedule:
        """The cheapest way along a clip: one damping, the Jacobian carried from frame to frame, nothing rescued."""
        steps = min(self.refinement.steps, LEAN_STEPS)
        refinement = replace(self.refinement, steps=steps, dampings=DAMPINGS[1], jacobians=0)
        return replace(self, refinement=refinement, basin=math.inf, rescue=math.inf)


def make_schedule(
    config: RunConfig, search: Any, objective: Objective, reference: Features, noise: float = 0.0
) -> Schedule:
    """The schedule of ``config`` for a reference of N frames, whose totals are uncertain by ``noise``."""
    tolerance = max(config.tolerance, QUIET * noise)
    free = config.zoom == "free"
    if config.zoom in ("auto", "still"):
        free = tells_lens(objective, reference)
    refined = config.engine == "refine"
    alone = _why_cma_alone(config, search, objective) if refined else ""
    generations = min(POLISH.generations, len(reference)) * (TWICE if config.joint > 1 else 1)
    return Schedule(
        engine="cma" if alone else config.engine,
        budget=Budget(config.generations, config.patience, config.popsize, tolerance),
        refinement=Refinement(config.steps, DAMPINGS[config.dampings], config.jacobians, tolerance),
        adam=config.adam,
        sigma=config.sigma0,
        warm_sigma=config.warm_sigma,
        warm=config.warm_start,
        basin=config.basin,
        rescue=config.rescue,
        renewed=config.jacobians == 0,
        lean_limit=config.lean,
        free_lens=free,
        placed=bool(objective.placed(reference).any()),
        polish=replace(POLISH, generations=generations) if _still(objective, reference, tolerance) else None,
        seed=config.seed,
        note=alone or (_why_unguided(config, search, reference) if refined else ""),
    )


def tells_lens(objective: Objective, reference: Features) -> bool:
    """Whether some frame of a reference tells a focal length apart from distance: by what is before or behind somebody.

    Filmic space is defined, as 0, of a person before nothing too.
    """
    for name in counted(objective.losses):
        defined = objective.defined(reference)[:, objective.names.index(name)]
        if bool(defined.any()):
            defined = defined & objective.losses[name].directions(reference, reference).isfinite().any(1)
        if bool(defined.any()):
            return True
    return False


def _still(objective: Objective, reference: Features, tolerance: float) -> bool:
    """Whether every frame shows what the second one would at rest, by the losses. The first one has no flow."""
    if len(reference) < 3:
        return False
    defined, rest = objective.defined(reference) & objective.weighs, reference[1]
    if rest.has("flow"):  # a steady move looks the same in every frame too
        rest = rest.having("flow", torch.zeros_like(rest.require("flow")))
    alike = objective.totals(objective.terms(rest, reference), defined) <= tolerance
    return bool((defined[1:] == defined[1]).all() and alike.all())


def _why_unguided(config: RunConfig, search: Any, reference: Features) -> str:
    """Why nothing guides a refinement, where ``guide`` asks for a path that the search alone forbids."""
    asked = config.guide and config.warm_start and reference.has("keypoints")
    return UNGUIDED if asked and not isinstance(search, SubjectOrbit) else ""


def _why_cma_alone(config: RunConfig, search: Any, objective: Objective) -> str:
    if not getattr(search, "refinable", True):
        return (
            f"CMA-ES alone: {next(iter(config.search))} turns about a free axis, which no slope tells before it turns"
        )
    if config.extract.inner == "image":
        return "CMA-ES alone: differences taken through noisy networks mislead a refinement"
    if not (without := objective.without_residuals):
        return ""
    return f"CMA-ES alone: {', '.join(without)} has no residuals to refine, nor to tell whether a camera is determined"
