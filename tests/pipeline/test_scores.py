"""Why a term has no value is told of the side that lacks it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import pytest
import torch
from torch import Tensor

from cltransfer.features import Features
from cltransfer.pipeline.objective import Objective
from cltransfer.pipeline.scores import score


@dataclass(frozen=True)
class Pace:
    """Difference of the mean flow."""

    requires: ClassVar[tuple[str, ...]] = ("flow",)
    unit: ClassVar[str] = "px"
    penalty: ClassVar[float] = 50.0
    weight: float = 1.0

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        return (rendered.require("flow") - reference.require("flow")).abs().mean((1, 2, 3))


@pytest.mark.parametrize(
    ("frames", "moving", "reason"),
    [
        (1, "flow", "needs two frames, one is scored"),
        (2, "flow", "undefined on every frame of the reference"),
        (1, "gaze", "undefined on every frame of the reference"),
    ],
)
def test_a_term_of_motion_is_told_to_need_two_frames_where_one_is_scored(frames: int, moving: str, reason: str) -> None:
    unknown = Features((4, 3), flow=torch.full((frames, 2, 3, 4), torch.nan))
    (term,) = score(Objective({"pace": Pace()}, frozenset({moving})), unknown, unknown, {}).terms
    assert term.reason == reason
