"""What one frame teaches the next, and what is done where a frame ends in the wrong basin."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
import torch
from torch import Tensor

from cltransfer.camera import Camera
from cltransfer.config import load_config
from cltransfer.driver.cma_es import Budget
from cltransfer.driver.frame import SAME, Memory, Solved, carried, solve
from cltransfer.driver.problem import Problem
from cltransfer.driver.retry import RESCUE, Retry
from cltransfer.driver.schedule import Schedule, make_schedule
from cltransfer.driver.stage import Stage
from cltransfer.driver.view import View
from cltransfer.features import Features
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.objective import Objective
from cltransfer.scenes import Scene
from cltransfer.scenes.splats import Splats
from cltransfer.subject import Subject

DECOY, FAR, STEEP = 3.0, 0.15, 25.0  # total of the basin at 0; where the other one lies, and its slope


def test_a_frame_that_begins_as_the_last_one_ended_has_nothing_new() -> None:
    residuals = torch.tensor([0.3, -0.1, 0.0], dtype=torch.float64)
    memory = Memory(settled=residuals)
    assert memory.nothing_new(residuals)
    assert memory.nothing_new(residuals + 0.5 * SAME)
    assert not memory.nothing_new(residuals + torch.tensor([0.0, 0.0, 2 * SAME]))


def test_nothing_is_known_to_be_the_same_where_the_last_frame_could_still_gain() -> None:
    assert not Memory().nothing_new(torch.zeros(3, dtype=torch.float64))


@dataclass(frozen=True)
class Slide:
    """A search that moves the camera along two axes of the world."""

    dimensions: int = 2

    def bounds(self) -> tuple[Tensor, Tensor]:
        return -torch.ones(2, dtype=torch.float64), torch.ones(2, dtype=torch.float64)

    def cameras(self, x: Tensor, home: Camera, subject: Subject | None) -> Camera:
        w2c = home.w2c.expand(len(x), 4, 4).clone()
        w2c[:, :3, 3] -= (w2c[:, :3, :2] @ x[..., None])[..., 0]
        return Camera(w2c, home.K.expand(len(x), 3, 3), home.size)


@dataclass(frozen=True)
class Basins:
    """A loss of two basins: one at the place (0, 0), one where the reference stands, which the residuals price too."""

    home: Camera
    price: float = 0.0

    weight: ClassVar[float] = 1.0
    requires: ClassVar[tuple[str, ...]] = ("camera",)
    unit: ClassVar[str] = "m"
    penalty: ClassVar[float] = 10.0
    groups: ClassVar[tuple[int, ...]] = (0, 0, 0)

    def priced(self, reference: Features, rendered: Features, price: float) -> Tensor:
        place = rendered.require("camera").center[:, :2] - self.home.center[:, :2]
        off = place - (reference.require("camera").center[:, :2] - self.home.center[:, :2])
        decoy = torch.stack([DECOY + 20 * (place**2).sum(1), *torch.zeros(2, len(place))], dim=1)
        true = torch.stack([torch.full((len(place),), price), *STEEP * off.T], dim=1)
        return torch.where((STEEP * off.norm(dim=1) < decoy.norm(dim=1))[:, None], true, decoy)

    def residuals(self, reference: Features, rendered: Features) -> Tensor:
        return self.priced(reference, rendered, self.price)

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        return self.priced(reference, rendered, 0.0).norm(dim=1)


def speck() -> Splats:
    """A scene of one Gaussian: nobody looks at it."""
    one = torch.ones(1)
    return Splats(torch.zeros(1, 3), torch.ones(1, 3), torch.eye(4)[:1], one, torch.zeros(1, 1, 3), one)


def planted(price: float = 0.0) -> tuple[Problem, Schedule]:
    """A frame whose residuals lead into the basin at 0; the better one, unless it has a price, is beside it."""
    config, size, up = load_config(), (32, 18), torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    home = Camera.look_at(torch.zeros(1, 3, dtype=torch.float64), torch.eye(3, dtype=torch.float64)[0], up, 0.7, size)
    parts, objective, search = Components.build(config), Objective({"basins": Basins(home, price)}), Slide()
    plan = replace(parts.plan("scene"), steps=(), buffers=frozenset())
    stage = Stage(Scene(speck(), None, up, "speck", ""), parts.renderer, plan, objective, size)
    place = torch.tensor([[FAR, 0.0]], dtype=torch.float64)
    reference = Features(size, camera=search.cameras(place, home, None))
    problem = Problem(stage, search, home, reference, None, objective.defined(reference)[0], True)
    return problem, make_schedule(config, search, objective, reference)


def solved(problem: Problem, schedule: Schedule, first: bool) -> Solved:
    memory = Memory() if first else Memory(None, torch.zeros(3, 2).double(), torch.ones(3, dtype=torch.bool), (0.1,))
    return solve(problem, torch.zeros(1, 2, dtype=torch.float64), memory, schedule, np.random.default_rng(0))


@pytest.mark.parametrize("first", [True, False], ids=["first", "later"])
def test_a_frame_in_the_wrong_basin_is_rescued_where_its_total_is_above_the_limit(first: bool) -> None:
    problem, schedule = planted()
    rescued = solved(problem, replace(schedule, basin=1.0, rescue=1.0), first)
    assert rescued.stop.startswith("rescued, ")
    assert rescued.generations > 0
    torch.testing.assert_close(rescued.x, torch.tensor([FAR, 0.0], dtype=torch.float64), atol=1e-3, rtol=0)
    left = solved(problem, replace(schedule, basin=math.inf, rescue=math.inf), first)
    assert (left.generations, left.stop) == (0, "worth")
    assert left.total == pytest.approx(DECOY)


def test_a_first_frame_that_stands_for_all_is_polished_however_good_it_is() -> None:
    """The basin beside it is nearer than one step of the search from the initial view."""
    problem, schedule = planted()
    lean = replace(schedule, basin=math.inf, rescue=math.inf, polish=Budget(generations=24, patience=8, popsize=10))
    polished = solved(problem, lean, first=True)
    assert 0 < polished.generations <= 24
    assert polished.total < 0.1 * DECOY
    assert solved(problem, lean, first=False).generations == 0


def test_a_frame_after_those_that_show_nothing_stands_for_all_too() -> None:
    problem, schedule = planted()
    lean = replace(schedule, basin=math.inf, rescue=math.inf, polish=Budget(generations=24, patience=8, popsize=10))
    memory = Memory(None, torch.zeros(3, 2, dtype=torch.float64), torch.zeros(3, dtype=torch.bool))
    start = torch.zeros(1, 2, dtype=torch.float64)
    second = replace(problem, before=View(problem.cameras(start), lambda: problem.reference, None))
    assert solve(second, start, memory, lean, np.random.default_rng(0)).total < 0.1 * DECOY


def test_a_first_frame_of_which_nothing_is_known_is_not_searched() -> None:
    problem, schedule = planted()
    starts = torch.tensor([[0.5, 0.5], [0.0, 0.0]], dtype=torch.float64)
    unknown = replace(problem, defined=torch.zeros_like(problem.defined))
    found = solve(unknown, starts, Memory(), schedule, np.random.default_rng(0))
    assert (found.total, found.x.tolist()) == (0, [0.5, 0.5])
    assert problem.stage.spent.evaluations == 0


@pytest.mark.parametrize("first", [True, False], ids=["first", "later"])
def test_a_rescue_that_ends_in_a_worse_basin_is_thrown_away(first: bool) -> None:
    problem, schedule = planted(price=2 * DECOY)
    kept = solved(problem, replace(schedule, basin=1.0, rescue=1.0), first)
    assert kept.generations > 0
    assert kept.stop == "worth"
    assert kept.total == pytest.approx(DECOY)
    torch.testing.assert_close(kept.x, torch.zeros(2, dtype=torch.float64), atol=0.02, rtol=0)


@pytest.mark.parametrize(
    ("price", "again"), [(0.0, replace(RESCUE, wait=1)), (2 * DECOY, replace(RESCUE, wait=4))], ids=["helps", "in vain"]
)
def test_a_rescue_tells_how_soon_another_frame_may_be(price: float, again: Retry) -> None:
    problem, schedule = planted(price=price)
    found = solved(problem, replace(schedule, rescue=1.0), first=False)
    assert found.memory.rescue == again
    lost = torch.zeros(1, 2, dtype=torch.float64)
    memory = replace(found.memory, totals=(0.1,), jacobian=torch.zeros(3, 2, dtype=torch.float64))
    later = solve(problem, lost, memory, replace(schedule, rescue=1.0), np.random.default_rng(0))
    assert (later.generations > 0) == (again.wait == 1)


@pytest.mark.parametrize("rescue", [1.0, math.inf])
def test_a_frame_that_begins_as_a_bad_one_ended_is_rescued_like_that(rescue: float) -> None:
    problem, schedule = planted()
    lost = problem.residuals(torch.zeros(1, 2, dtype=torch.float64))[0]
    memory = Memory(None, torch.zeros(3, 2).double(), torch.ones(3, dtype=torch.bool), (0.1,), settled=lost)
    start = torch.zeros(1, 2, dtype=torch.float64)
    found = solve(problem, start, memory, replace(schedule, rescue=rescue), np.random.default_rng(0))
    assert found.stop.startswith("rescued, ") if rescue == 1.0 else found.stop == "as before"


def test_a_frame_that_is_carried_on_stays_within_the_bounds() -> None:
    problem, schedule = planted()
    found = carried(problem, torch.tensor([[1.5, 0.0]], dtype=torch.float64), Memory(), schedule)
    assert found.x.tolist() == [1.0, 0.0]
    assert found.total == float(problem.totals(found.x[None])[0])
