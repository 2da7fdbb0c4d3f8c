"""Ask and tell: reproducible, bounded, stopped for a stated reason."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from cltransfer.driver.cma_es import Budget, Minimum, Start, minimise, reflected

CENTER = torch.tensor([0.3, -0.2, 0.6], dtype=torch.float64)


def bowl(x: Tensor) -> Tensor:
    return ((x - CENTER) ** 2).sum(1)


def solve(seed: int = 0, budget: Budget | None = None, start: Tensor | None = None, box: float = 1.0) -> Minimum:
    start = torch.zeros(3, dtype=torch.float64) if start is None else start
    bounds = (torch.full((3,), -box, dtype=torch.float64), torch.full((3,), box, dtype=torch.float64))
    return minimise(bowl, Start(start, 0.1), bounds, budget or Budget(), np.random.Generator(np.random.PCG64(seed)))


def test_a_bowl_is_solved() -> None:
    found = solve()
    torch.testing.assert_close(found.x, CENTER, atol=1e-5, rtol=0)


def test_the_same_seed_gives_the_same_bits_and_another_seed_does_not() -> None:
    assert torch.equal(solve(1).x, solve(1).x)
    assert not torch.equal(solve(1).x, solve(2).x)


def test_the_global_random_state_is_left_alone() -> None:
    np.random.seed(5)  # noqa: NPY002
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    solve()
    assert np.array_equal(before, np.random.get_state()[1])  # noqa: NPY002


def test_the_box_is_respected() -> None:
    seen: list[Tensor] = []

    def watched(x: Tensor) -> Tensor:
        seen.append(x)
        return bowl(x)

    low, high = torch.full((3,), -0.1, dtype=torch.float64), torch.full((3,), 0.1, dtype=torch.float64)
    generator = np.random.Generator(np.random.PCG64(0))
    found = minimise(watched, Start(torch.zeros(3), 0.3), (low, high), Budget(20), generator)
    x = torch.cat(seen)
    assert len(x) == 1 + found.generations * Budget(20).popsize
    assert bool((x >= low).all())
    assert bool((x <= high).all())


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_box_that_is_open_on_one_side_is_respected_on_the_other(side: float) -> None:
    low, high = torch.tensor([-1.0]), torch.tensor([torch.inf])
    if side < 0:
        low, high = -high, -low
    x = side * torch.tensor([[-3.0], [-1.0], [0.5], [40.0]])
    assert (side * reflected(x, low, high))[:, 0].tolist() == [1.0, -1.0, 0.5, 40.0]


def test_an_infinite_bound_is_free() -> None:
    low = torch.tensor([-torch.inf, -1, -1], dtype=torch.float64)
    start = torch.tensor([4.0, 0, 0], dtype=torch.float64)
    found = minimise(bowl, Start(start, 0.3), (low, -low), Budget(400, 100), np.random.Generator(np.random.PCG64(0)))
    torch.testing.assert_close(found.x, CENTER, atol=1e-4, rtol=0)


@pytest.mark.parametrize(
    ("budget", "reason"),
    [(Budget(3, 20), "generations"), (Budget(10**4, 5), "patience"), (Budget(100, 20, tolerance=1e-3), "tolerance")],
)
def test_the_stop_reason_is_told(budget: Budget, reason: str) -> None:
    found = solve(budget=budget)
    assert found.stop == reason


def test_a_flat_landscape_ends_by_patience_and_keeps_the_start() -> None:
    start = torch.full((3,), 0.25, dtype=torch.float64)
    bounds = (-torch.ones(3, dtype=torch.float64), torch.ones(3, dtype=torch.float64))
    generator = np.random.Generator(np.random.PCG64(0))
    found = minimise(lambda x: torch.ones(len(x)), Start(start, 0.1), bounds, Budget(100, 20), generator)
    assert (found.stop, found.generations) == ("patience", 21)  # the first generation is the best asked so far
    torch.testing.assert_close(found.x, start)


def test_the_result_is_never_worse_than_the_start() -> None:
    found = solve(start=CENTER.clone(), budget=Budget(5))
    assert found.total <= 1e-12


def test_a_learned_shape_saves_evaluations_when_the_valley_moves() -> None:
    stretch = torch.tensor([1.0, 30.0, 900.0], dtype=torch.float64)
    free = (torch.full((3,), -torch.inf, dtype=torch.float64), torch.full((3,), torch.inf, dtype=torch.float64))

    def run(start: Start, middle: Tensor) -> Minimum:
        budget = Budget(400, 400, tolerance=1e-6)
        generator = np.random.Generator(np.random.PCG64(0))
        return minimise(lambda x: (stretch * (x - middle) ** 2).sum(1), start, free, budget, generator)

    learned = run(Start(torch.zeros(3, dtype=torch.float64), 0.3), CENTER)
    moved = CENTER + torch.tensor([0.3, 0.02, 0.001], dtype=torch.float64)  # along the valley, as neighbours do
    assert torch.linalg.matrix_norm(learned.shape, 2) == pytest.approx(1)
    assert run(Start(CENTER, 0.3, learned.shape), moved).generations < 0.8 * run(Start(CENTER, 0.3), moved).generations
