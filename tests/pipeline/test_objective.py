"""Eq. 15 with undefined terms priced by name: leaving the frame never pays."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import pytest
import torch
from torch import Tensor

from cltransfer.errors import ModelError, UsageError
from cltransfer.features import Features
from cltransfer.pipeline.objective import Objective
from cltransfer.pipeline.scores import Scores, score


@dataclass(frozen=True)
class Distance:
    requires: ClassVar[tuple[str, ...]] = ("box",)
    unit: ClassVar[str] = "px"
    penalty: ClassVar[float] = 50.0
    weight: float = 2.0

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        return (reference.require("box") - rendered.require("box")).abs().sum(1)


@dataclass(frozen=True)
class Depth(Distance):
    requires: ClassVar[tuple[str, ...]] = ("depth",)
    weight: float = 7.0


@dataclass(frozen=True)
class Flat(Distance):
    """Knows every frame."""

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        return torch.zeros(len(rendered))


def boxes(*values: float) -> Features:
    return Features((8, 8), box=torch.nn.functional.pad(torch.tensor(values)[:, None], (0, 4)))


OBJECTIVE = Objective({"distance": Distance(), "depth": Depth()})


def test_totals_weigh_and_skip_what_the_reference_lacks() -> None:
    reference, rendered = boxes(1.0), boxes(1.0, 4.0)
    terms = OBJECTIVE.terms(reference, rendered)
    defined = OBJECTIVE.defined(reference)[0]
    assert defined.tolist() == [True, False]
    assert bool(torch.isnan(terms[:, 1]).all())
    assert OBJECTIVE.totals(terms, defined).tolist() == [0.0, 6.0]


def test_a_term_that_only_the_render_lacks_costs_its_penalty() -> None:
    reference, rendered = boxes(1.0), boxes(float("nan"))
    totals = OBJECTIVE.totals(OBJECTIVE.terms(reference, rendered), OBJECTIVE.defined(reference)[0])
    assert totals.tolist() == [100.0]


@dataclass(frozen=True)
class Broken(Distance):
    """Answers with ``how``, or raises it."""

    groups: ClassVar[tuple[int, ...]] = (0,)
    how: object = None

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        if isinstance(self.how, Exception):
            raise self.how
        return self.how  # type: ignore[return-value]

    residuals = __call__


def test_a_loss_below_zero_is_refused_but_for_rounding() -> None:
    objective = Objective({"mine": Broken(how=torch.tensor([0.5, -0.25]))})
    with pytest.raises(ModelError, match=r"^loss 'mine': expected values of 0 or more, got -0.25 \(0 is where"):
        objective.terms(boxes(1.0), boxes(1.0, 2.0))
    terms = Objective({"mine": Broken(how=torch.tensor([float("nan"), -1e-9]))}).terms(boxes(1.0), boxes(1.0, 2.0))
    assert terms.isnan().flatten().tolist() == [True, False]


@pytest.mark.parametrize(
    ("how", "came"),
    [
        (torch.ones(2, 1), "got shape (2, 1)"),
        (torch.ones(()), "got shape ()"),
        (torch.ones(3), "got shape (3,)"),
        (0.5, "got float"),
        (None, "got NoneType"),
        (ArithmeticError("the loss has\nno answer"), "it raised ArithmeticError: the loss has no answer"),
    ],
)
def test_a_loss_that_gives_no_values_is_named_with_what_came(how: object, came: str) -> None:
    with pytest.raises(ModelError) as caught:
        Objective({"distance": Distance(), "broken": Broken(how=how)}).terms(boxes(1.0), boxes(1.0, 4.0))
    assert str(caught.value).startswith(f"loss 'broken': expected values of shape (2,), {came} (")
    assert caught.value.__cause__ is (how if isinstance(how, Exception) else None)


@pytest.mark.parametrize(("how", "came"), [(torch.ones(2), "got shape (2,)"), (KeyError("x"), "raised KeyError: 'x'")])
def test_a_loss_that_gives_no_residuals_is_named_with_what_came(how: object, came: str) -> None:
    with pytest.raises(ModelError) as caught:
        Objective({"broken": Broken(how=how)}).residuals(boxes(1.0), boxes(1.0, 4.0), torch.tensor([True]))
    assert "residuals of loss 'broken': expected values of shape (2, 1), " in str(caught.value)
    assert came in str(caught.value)


def test_a_loss_of_more_groups_than_residuals_is_told_what_groups_names() -> None:
    @dataclass(frozen=True)
    class Grouped(Broken):
        groups: ClassVar[tuple[int, ...]] = (0, 1)

    objective = Objective({"grouped": Grouped(how=torch.ones(1, 1))})
    told = (
        r"expected values of shape \(1, 2\), got shape \(1, 1\) \(one row .* residual for each of groups = \(0, 1\)\)"
    )
    with pytest.raises(ModelError, match=told):
        objective.residuals(boxes(0.5), boxes(1.0), torch.tensor([True]))
    with pytest.raises(ModelError, match=told):
        objective.check_residuals(boxes(0.5), torch.tensor([[True]]))


@pytest.mark.parametrize("weight", [1.0, 0.0])
def test_residuals_that_are_nan_where_the_value_is_known_are_refused_if_they_count(weight: float) -> None:
    """A search counts an undefined residual as the penalty: that loss would have no slope, and nothing told so."""
    losses, reference = {"broken": Broken(weight, how=torch.full((1, 1), torch.nan))}, boxes(1.0, 2.0)
    known = torch.tensor([[False], [True]])
    Objective(losses).check_residuals(reference, torch.zeros_like(known))
    if weight == 0:
        Objective(losses).check_residuals(reference, known)
        return
    with pytest.raises(ModelError, match=r"'broken': expected numbers where its value is one, got \[nan\] of frame 1"):
        Objective(losses).check_residuals(reference, known)


@pytest.mark.parametrize("how", [MemoryError(), UsageError("", "weight", "is too large")])
def test_what_is_told_already_is_told_as_it_is(how: Exception) -> None:
    with pytest.raises(type(how)) as caught:
        Objective({"broken": Broken(how=how)}).terms(boxes(1.0), boxes(1.0))
    assert caught.value is how


@dataclass(frozen=True)
class Sloped(Distance):
    groups: ClassVar[tuple[int, ...]] = (0, 0)

    def residuals(self, reference: Features, rendered: Features) -> Tensor:
        return (rendered.require("box") - reference.require("box"))[:, :2].double()


def test_a_loss_that_the_reference_has_on_no_frame_needs_no_residuals() -> None:
    """A plugin's whose extractor was forgotten would else leave the whole search to CMA-ES."""
    losses = {"blunt": Depth(), "sloped": Sloped()}
    assert Objective(losses).without_residuals == ["blunt"]
    assert Objective(losses).groups is None
    silent = Objective(losses, silent=frozenset({"blunt"}))
    assert silent.groups is not None
    assert silent.groups.tolist() == [0, 1, 1]
    defined = torch.tensor([False, True])
    found = silent.residuals(boxes(1.0), boxes(3.0), defined)
    assert found.tolist() == [[0.0, 4.0, 0.0]]
    assert silent.rows(defined).tolist() == [False, True, True]
    assert silent.paired.tolist() == [False] * 3
    assert silent.lost_residuals(defined).tolist() == [0.0, 100.0, 0.0]


@dataclass(frozen=True)
class Stepped(Sloped):
    """Knows what is 0.25 away, beyond a jump of its first residual."""

    shape: tuple[int, ...] = (2, 2)

    def beyond(self, reference: Features, rendered: Features) -> Tensor:
        told = torch.tensor([0.5, 0.25, torch.nan, 1.0]).reshape(2, 2)
        return told.expand(len(rendered), 2, 2).reshape(len(rendered), *self.shape)


def test_what_is_beyond_a_jump_is_weighed_and_as_it_is_where_none_is_known_of() -> None:
    objective = Objective({"sloped": Sloped(), "stepped": Stepped(), "lacking": Stepped()})
    told = objective.across(boxes(1.0), boxes(3.0, 4.0), torch.tensor([True, True, False]))
    torch.testing.assert_close(told.residuals, torch.tensor([[4.0, 0, 4, 0, 0, 0], [6, 0, 6, 0, 0, 0]]).double())
    torch.testing.assert_close(told.beyond, torch.tensor([[4.0, 0, 1, 0, 0, 0], [6, 0, 1, 0, 0, 0]]).double())
    torch.testing.assert_close(told.far, torch.tensor([[0, 0, 0.25, 0, 0, 0]]).double().expand(2, 6))


def test_a_loss_that_does_not_tell_what_is_beyond_as_it_should_is_named_with_what_came() -> None:
    with pytest.raises(ModelError, match=r"^beyond of loss 'stepped': expected values of shape \(1, 2, 2\), got shape"):
        Objective({"stepped": Stepped(shape=(4,))}).across(boxes(1.0), boxes(3.0), torch.tensor([True]))


def test_a_frame_the_reference_lacks_costs_nothing_whatever_is_rendered() -> None:
    reference = boxes(float("nan"))
    totals = OBJECTIVE.totals(OBJECTIVE.terms(reference, boxes(3.0)), OBJECTIVE.defined(reference)[0])
    assert totals.tolist() == [0.0]


def test_a_loss_that_holds_weights_gives_values_without_gradients_here_and_with_them_when_it_is_called() -> None:
    weight = torch.nn.Parameter(torch.tensor(2.0))

    class Learnt(Distance):
        def __call__(self, reference: Features, rendered: Features) -> Tensor:
            return weight * super().__call__(reference, rendered)

    found = Objective({"learnt": Learnt()}).terms(boxes(1.0), boxes(3.0))
    assert (found.tolist(), found.requires_grad) == ([[4.0]], False)
    assert Learnt()(boxes(1.0), boxes(3.0)).requires_grad


@dataclass(frozen=True)
class Signed(Distance):
    groups: ClassVar[tuple[int, ...]] = (0,)

    def residuals(self, reference: Features, rendered: Features) -> Tensor:
        return (rendered.require("box") - reference.require("box")).sum(1, keepdim=True)


@pytest.mark.parametrize(("weight", "without"), [(0.0, []), (1.0, ["metric"])])
def test_a_metric_that_weighs_nothing_needs_no_residuals(weight: float, without: list[str]) -> None:
    objective = Objective({"metric": Distance(weight=weight), "sloped": Signed()})
    assert objective.without_residuals == without
    assert (objective.groups is None) == bool(without)
    reference, rendered, both = boxes(1.0), boxes(4.0, 0.5), torch.tensor([True, True])
    assert objective.terms(reference, rendered)[:, 0].tolist() == [3.0, 0.5]  # measured all the same
    if without:
        return
    assert objective.residuals(reference, rendered, both).tolist() == [[0.0, 6.0], [0.0, -1.0]]
    assert objective.across(reference, rendered, both).beyond.tolist() == [[0.0, 6.0], [0.0, -1.0]]
    assert objective.lost_residuals(both).tolist() == [0.0, 100.0]


@pytest.mark.parametrize(("weight", "expected"), [(0.0, [2.0, float("nan")]), (7.0, [2.0, 0.0])])
def test_a_frame_of_which_only_terms_that_weigh_nothing_are_known_has_no_total(
    weight: float, expected: list[float]
) -> None:
    reference, rendered = boxes(1.0, float("nan")), boxes(2.0, 2.0)
    objective = Objective({"distance": Distance(), "metric": Flat(weight=weight)})
    totals = score(objective, reference, rendered, {}).totals
    torch.testing.assert_close(totals, torch.tensor(expected).double(), equal_nan=True)


@pytest.mark.parametrize("weight", [0.0, 7.0])
def test_a_term_that_weighs_nothing_does_not_tell_where_to_stand(weight: float) -> None:
    objective = Objective({"distance": Distance(), "metric": Flat(weight=weight)})
    assert objective.placed(boxes(1.0, float("nan"))).tolist() == [True, weight > 0]


def test_why_a_term_is_missing_is_told_once() -> None:
    """What no extractor provides says so of itself; a reason beside the features has to say of what."""
    still = replace(boxes(1.0), reasons={"depth": "it stands still"})
    for reference, missing, told in (
        (still, {}, "the reference has no 'depth': it stands still"),
        (boxes(1.0), {"depth": "no extractor provides 'depth'"}, "no extractor provides 'depth'"),
        (boxes(1.0), {}, "the reference has no 'depth'"),
    ):
        assert score(OBJECTIVE, reference, boxes(1.0), missing).term("depth").reason == told


def test_where_no_loss_weighs_anything_totals_are_zero() -> None:
    objective = Objective({"distance": Distance(weight=0.0)})
    totals = score(objective, boxes(1.0, float("nan")), boxes(2.0, 2.0), {}).totals
    assert totals.isnan().tolist() == [False, True]
    assert totals[0] == 0.0


def test_a_frame_that_nothing_is_told_of_is_not_perfect() -> None:
    assert Scores((), torch.tensor([math.nan, 1.0])).total == 1.0
