"""What a loss says is held against itself: a search by residuals of another value would find what is no better."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import pytest
import torch
from torch import Tensor

from cltransfer.config import load_config
from cltransfer.errors import ModelError
from cltransfer.features import Features
from cltransfer.pipeline.answers import LOOKS
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.objective import Objective
from cltransfer.testing import sample_features, without_person


@dataclass(frozen=True)
class Aside:
    """Distance of boxes, whose residuals are ``share`` of it; it counts how often its value is asked for."""

    requires: ClassVar[tuple[str, ...]] = ("box",)
    unit: ClassVar[str] = "px"
    penalty: ClassVar[float] = 50.0
    groups: ClassVar[tuple[int, ...]] = (0, 0, 1)
    weight: float = 2.0
    share: float = 1.0
    asked: list[int] = field(default_factory=list)

    def residuals(self, reference: Features, rendered: Features) -> Tensor:
        return self.share * (rendered.require("box") - reference.require("box"))[:, :3]

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        self.asked.append(len(rendered))
        apart = (rendered.require("box") - reference.require("box"))[:, :3]
        return apart[:, :2].norm(dim=1) + apart[:, 2].abs()


def boxes(*values: float) -> Features:
    return Features((8, 8), box=torch.tensor(values)[:, None] * torch.tensor([3.0, 4, 1, 0, 0]))


def scored(loss: Aside, *batches: Features) -> Objective:
    objective = Objective({"aside": loss})
    for batch in batches:
        objective.residuals(boxes(1.0), batch, torch.tensor([True]))
    return objective


def test_residuals_of_another_value_are_refused_at_the_first_view_that_tells() -> None:
    line = r"^loss 'aside': its residuals come to 3, its value is 6 \(the value is .* groups = \(0, 0, 1\) "
    with pytest.raises(ModelError, match=line):
        scored(Aside(share=0.5), boxes(float("nan"), 1.0, 2.0))
    with pytest.raises(ModelError, match="its residuals come to 0, its value is 6 "):
        scored(Aside(share=0.0), boxes(1.0), boxes(2.0))
    scored(Aside(share=1.005), boxes(2.0))  # rounded off


def test_a_view_of_nobody_whose_residuals_are_numbers_is_refused() -> None:
    @dataclass(frozen=True)
    class Free(Aside):
        def residuals(self, reference: Features, rendered: Features) -> Tensor:
            return super().residuals(reference, rendered).nan_to_num(0.0)

    for views in (boxes(2.0, float("nan")), boxes(float("nan"), 1.0)):
        with pytest.raises(ModelError, match=r"come to 0, its value is nan \(a term is NaN in both or in neither\)$"):
            scored(Free(), views)


def test_nothing_is_held_against_what_is_undefined_the_same_or_weighs_nothing() -> None:
    scored(Aside(share=0.5), boxes(1.0, float("nan")), boxes(1.0))
    scored(Aside(share=0.5, weight=0.0), boxes(2.0))
    Objective({"aside": Aside(share=0.5)}).residuals(boxes(1.0), boxes(2.0), torch.tensor([False]))


def test_the_value_is_asked_for_once_a_run_and_seldom_where_it_tells_nothing() -> None:
    once, never = Aside(), Aside()
    scored(once, boxes(2.0, 3.0), boxes(4.0), boxes(5.0))
    assert once.asked == [2]
    scored(never, *[boxes(1.0)] * 9)
    assert len(never.asked) == LOOKS


@pytest.mark.parametrize("preset", ["balanced", "paper", "jaws_losses_cma"])
def test_residuals_of_ours_are_of_their_values(preset: str) -> None:
    losses = Components.build(load_config(overrides=[f"preset={preset}"])).losses
    objective, reference = Objective(losses), sample_features(1, 1)
    rendered = Features.concatenate([sample_features(2, 3), without_person(sample_features(3, 1))])
    objective.residuals(reference, rendered, objective.defined(reference)[0])
    assert {name for name, loss in losses.items() if hasattr(loss, "residuals")} == set(objective._looks)
