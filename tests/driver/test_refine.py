"""Reweighted least squares: sums of norms, few evaluations, a Jacobian worth keeping."""

from __future__ import annotations

import torch
from torch import Tensor

from cltransfer.driver.refine import LONGEST, Refinement, differences, flat_directions, least_curvature, refine
from cltransfer.pipeline.objective import group_norms

GROUPS = torch.tensor([0, 0, 1, 2])
TARGET = torch.tensor([0.2, -0.3, 0.1], dtype=torch.float64)


def bent(x: Tensor) -> Tensor:
    """Residuals (B, 4) of a smooth, not linear problem whose sum of norms is 0 at the target."""
    a, b, c = (x - TARGET).unbind(1)
    return torch.stack([3 * a + a * b, 2 * b, c + 0.5 * a**2, 4 * (a - c)], dim=1)


class Counted:
    def __init__(self) -> None:
        self.count = 0

    def __call__(self, x: Tensor) -> Tensor:
        self.count += len(x)
        return bent(x)


def test_a_bent_problem_is_solved_in_few_evaluations() -> None:
    evaluate = Counted()
    found = refine(evaluate, torch.zeros(3, dtype=torch.float64), GROUPS, Refinement(), None)
    torch.testing.assert_close(found.x, TARGET, atol=2e-3, rtol=0)
    assert evaluate.count < 40
    assert found.total < 0.02


def test_a_jacobian_kept_from_a_neighbour_saves_its_cost() -> None:
    start = torch.zeros(3, dtype=torch.float64)
    first = refine(bent, start, GROUPS, Refinement(), None)
    near = first.x + 0.02
    anew, saved = Counted(), Counted()
    refine(anew, near, GROUPS, Refinement(), None)
    kept = refine(saved, near, GROUPS, Refinement(), first.jacobian)
    assert saved.count < anew.count
    assert kept.total < 0.02


def test_the_result_is_never_worse_than_the_start() -> None:
    nonsense = torch.randn(4, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    start = TARGET + 0.1
    before = float(group_norms(bent(start[None]), GROUPS).sum())
    options = Refinement(jacobians=0)
    assert refine(bent, start, GROUPS, options, nonsense).total <= before


def test_a_group_that_cannot_vanish_does_not_drag_the_others() -> None:
    def conflict(x: Tensor) -> Tensor:  # one group wants 1, two groups want 0: a sum of norms sides with the two
        return torch.cat([x - 1, x, 1.5 * x], dim=1)

    found = refine(conflict, torch.full((1,), 0.5, dtype=torch.float64), torch.tensor([0, 1, 2]), Refinement(20), None)
    assert abs(float(found.x)) < 0.02


def test_a_direction_that_costs_nothing_shows_in_the_curvature() -> None:
    J = torch.tensor([[1.0, 0.0], [2.0, 0.0]], dtype=torch.float64)
    r = torch.ones(2, dtype=torch.float64)
    groups = torch.tensor([0, 1])
    assert abs(least_curvature(J, r, groups)) < 1e-12
    assert least_curvature(J + torch.tensor([[0.0, 1.0], [0.0, 0.0]]), r, groups) > 0.05


def test_steps_bound_the_evaluations() -> None:
    evaluate = Counted()
    found = refine(evaluate, torch.zeros(3, dtype=torch.float64), GROUPS, Refinement(2, (3e-2,), 0), None)
    assert found.stop == "steps"
    assert evaluate.count == 1 + 3 + 2


def test_the_box_is_respected_and_its_edge_is_found() -> None:
    seen: list[Tensor] = []

    def watched(x: Tensor) -> Tensor:
        seen.append(x)
        return bent(x)

    low, high = torch.full((3,), -0.1, dtype=torch.float64), torch.full((3,), 0.15, dtype=torch.float64)
    found = refine(watched, torch.zeros(3, dtype=torch.float64), GROUPS, Refinement(), None, (low, high))
    asked = torch.cat(seen)
    assert bool(((asked >= low) & (asked <= high)).all())
    assert (float(found.x[0]), float(found.x[1])) == (0.15, -0.1)  # the target lies outside


def test_a_start_that_was_evaluated_is_not_evaluated_again() -> None:
    start, evaluate, whole = torch.zeros(3, dtype=torch.float64), Counted(), Counted()
    known = refine(evaluate, start, GROUPS, Refinement(), None, residuals=bent(start[None])[0])
    anew = refine(whole, start, GROUPS, Refinement(), None)
    assert torch.equal(known.x, anew.x)
    assert evaluate.count == whole.count - 1


def test_the_flat_direction_of_a_valley_is_the_long_one() -> None:
    """A valley along (1, 1, 0), a hundred times flatter there, and rough: narrow differences tell of the roughness."""
    across = torch.tensor([[1.0, -1.0, 0.0], [0.0, 0.0, 1.0], [0.01, 0.01, 0.0]], dtype=torch.float64)

    def rough(x: Tensor) -> Tensor:
        return x @ across.T + 1e-3 * torch.sin(x.sum(1, keepdim=True) / 1e-3)

    x, groups = torch.tensor([0.3, 0.2, 0.1], dtype=torch.float64), torch.tensor([0, 1, 2])
    along = torch.tensor([1.0, 1.0, 0.0], dtype=torch.float64) / 2**0.5
    r = rough(x[None])[0]
    wide = flat_directions(differences(rough, x, r, None, 0.5), r, groups)
    lengths, axes = torch.linalg.eigh(wide @ wide.T)
    torch.testing.assert_close(lengths[-1].sqrt(), torch.tensor(1.0, dtype=torch.float64))
    assert abs(float(axes[:, -1] @ along)) > 0.99
    assert float(lengths[1].sqrt()) < 0.3
    narrow = flat_directions(differences(rough, x, r, None), r, groups)
    assert abs(float(torch.linalg.eigh(narrow @ narrow.T)[1][:, -1] @ along)) < 0.99


def test_no_direction_is_taken_for_flatter_than_so_much() -> None:
    blind = torch.diag(torch.tensor([1.0, 1.0, 0.0], dtype=torch.float64))
    shape = flat_directions(blind, torch.zeros(3, dtype=torch.float64), torch.arange(3))
    lengths = torch.linalg.svdvals(shape)
    torch.testing.assert_close(lengths, torch.tensor([1.0, 0.1, 0.1], dtype=torch.float64), atol=2e-3, rtol=0)


def test_where_nothing_changes_every_direction_is_as_flat() -> None:
    """As of a person who is cut off in every candidate: all terms are penalties, without a slope."""
    nothing = torch.zeros(4, 3, dtype=torch.float64)
    torch.testing.assert_close(
        flat_directions(nothing, bent(nothing[:1])[0], GROUPS), torch.eye(3, dtype=torch.float64)
    )


def test_few_steps_that_gain_nothing_say_so_and_those_that_gain_do_not() -> None:
    def rough(x: Tensor) -> Tensor:  # a pixel's step, that no slope knows of, is in the way of any move
        return torch.cat([x - 1, 100 * (x != 0).any(1, keepdim=True)], dim=1)

    one, groups, slopes = (
        torch.zeros(1, dtype=torch.float64),
        torch.tensor([0, 1]),
        torch.tensor([[1.0], [0.0]]).double(),
    )
    few = Refinement(steps=3, dampings=(1e-3,), jacobians=0)
    assert refine(rough, one, groups, few, slopes).stop == "worth"
    assert refine(bent, torch.zeros(3, dtype=torch.float64), GROUPS, Refinement(steps=1), None).stop == "steps"


POINTS = torch.tensor([[0.0, 0.0], [4.0, 0.0], [1.0, 3.0]], dtype=torch.float64)
FERMAT = torch.tensor([1.302169, 1.046746], dtype=torch.float64)  # least sum of distances, by scipy's Nelder-Mead


def test_a_group_is_weighed_by_its_norm_and_not_each_residual_by_itself() -> None:
    """Of three points: by each residual it would be the medians of their coordinates, by squares their mean."""
    found = refine(
        lambda x: (x[:, None] - POINTS).flatten(1),
        torch.tensor([2.0, 2.0], dtype=torch.float64),
        torch.tensor([0, 0, 1, 1, 2, 2]),
        Refinement(steps=40),
        None,
    )
    torch.testing.assert_close(found.x, FERMAT, atol=0.12, rtol=0)


def test_no_step_goes_farther_than_the_longest() -> None:
    asked = list[torch.Tensor]()

    def far(x: torch.Tensor) -> torch.Tensor:
        asked.append(x)
        return x - 100

    zero = torch.zeros(1, dtype=torch.float64)
    refine(far, zero, torch.tensor([0]), Refinement(steps=1), torch.ones(1, 1, dtype=torch.float64))
    assert float(torch.cat(asked).abs().max()) <= LONGEST
