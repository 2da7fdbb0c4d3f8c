"""Eq. 15 with undefined terms priced by name: leaving the frame never pays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from cltransfer.features import Features
from cltransfer.objective import Objective


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


def boxes(*values: float) -> Features:
    return Features((8, 8), box=torch.tensor(values)[:, None])


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


def test_a_frame_the_reference_lacks_costs_nothing_whatever_is_rendered() -> None:
    reference = boxes(float("nan"))
    totals = OBJECTIVE.totals(OBJECTIVE.terms(reference, boxes(3.0)), OBJECTIVE.defined(reference)[0])
    assert totals.tolist() == [0.0]
