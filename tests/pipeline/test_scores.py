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
from cltransfer.reading.feature_file import FeatureFile
from cltransfer.report.data import ReportData


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


def test_scores_are_told_apart_by_which_they_are_as_features_are() -> None:
    """Tensors of several values have no truth, so that no value that holds some can be compared by them."""
    flow = torch.zeros(2, 2, 4, 6)
    sides = Features((6, 4), flow=flow), Features((6, 4), flow=flow + 1)
    one, other = (score(Objective({"pace": Pace()}), *sides, {}) for _ in range(2))
    reports, files = (
        [ReportData("a", torch.arange(2.0), s, None, None, None, None, None, (), {}) for s in (one, other)],
        [FeatureFile(sides[0], torch.arange(2.0), "") for _ in range(2)],
    )
    for first, second in ((one, other), (one.terms[0], other.terms[0]), reports, files):
        assert first == first
        assert first != second
        assert len({first, second}) == 2
