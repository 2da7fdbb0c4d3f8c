"""A contract case says what it lacks, instead of failing somewhere inside a component."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import pytest
import torch
from torch import Tensor

from cltransfer.features import Features
from cltransfer.testing import LossCase, sample_features


@dataclass(frozen=True)
class GazeMatch:
    weight: float = 1.0
    requires: ClassVar[tuple[str, ...]] = ("gaze",)
    unit: ClassVar[str] = "rad"
    penalty: ClassVar[float] = 1.0

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        return (rendered.require("gaze") - reference.require("gaze")).abs().sum(1)


class Unaware(LossCase):
    component: ClassVar[Any] = GazeMatch()


class TestGazeMatch(LossCase):
    component = GazeMatch()

    def sample(self, seed: int, batch: int) -> Features:
        gaze = torch.rand(batch, 2, generator=torch.Generator().manual_seed(seed))
        return sample_features(seed, batch).having("gaze", gaze)


@pytest.mark.parametrize("test", ["test_names_what_it_requires", "test_scores_itself_zero", "test_batch_equals_single"])
def test_a_feature_that_the_frames_lack_is_named_with_how_to_give_it(test: str) -> None:
    with pytest.raises(AssertionError, match=r"^sample gives no gaze: override sample\(self, seed, batch\), .*'gaze'"):
        getattr(Unaware(), test)()
