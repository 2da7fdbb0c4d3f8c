"""The example plugin, loaded as a user's is."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from cltransfer.config import load_config
from cltransfer.errors import UsageError
from cltransfer.pipeline.objective import Objective
from cltransfer.plugins import allow
from cltransfer.registry import LOSSES
from cltransfer.testing import LossCase, sample_features

FILE = Path(__file__).resolve().parents[2] / "plugins" / "rule_of_thirds.py"


@pytest.fixture(autouse=True)
def allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The plugin is registered during a test and forgotten after it."""
    monkeypatch.setitem(LOSSES._classes, "rule_of_thirds", object)  # to be as it was, and nothing else with it
    del LOSSES._classes["rule_of_thirds"]
    allow([FILE])


class TestRuleOfThirds(LossCase):
    @pytest.fixture(autouse=True)
    def build(self, allowed: None) -> None:
        self.component = LOSSES.build("rule_of_thirds")


def test_crossings_of_the_thirds_are_at_distance_zero() -> None:
    distance_to_thirds = sys.modules[type(LOSSES.build("rule_of_thirds")).__module__].distance_to_thirds
    crossings = torch.cartesian_prod(torch.tensor([1.0, 2.0]), torch.tensor([1.0, 2.0])) / 3
    torch.testing.assert_close(distance_to_thirds(crossings), torch.zeros(4))
    torch.testing.assert_close(distance_to_thirds(torch.full((1, 2), 0.5)), torch.tensor([2**0.5 / 6]))


def test_left_third_matches_right_third() -> None:
    features = sample_features(1, 2)
    mirrored = features.keypoints.clone()
    mirrored[..., 0] = features.size[0] - mirrored[..., 0]
    value = LOSSES.build("rule_of_thirds")(features, replace(features, keypoints=mirrored))
    torch.testing.assert_close(value, torch.zeros(2).double(), atol=1e-6, rtol=0)


def test_no_joint_seen_is_undefined() -> None:
    features = sample_features(1, 2)
    unseen = features.keypoints.clone()
    unseen[..., 2] = 0.1
    loss = LOSSES.build("rule_of_thirds")
    assert loss(features, replace(features, keypoints=unseen)).isnan().all()
    assert loss(replace(features, keypoints=unseen), features).isnan().all()


def test_it_is_refined_with_the_others() -> None:
    losses = load_config(overrides=["losses.rule_of_thirds={}"]).build("losses")
    assert Objective(losses).groups is not None


def test_option_out_of_range_is_refused() -> None:
    with pytest.raises(UsageError, match=r"min_confidence must be in \[0, 1\), got 1"):
        LOSSES.build("rule_of_thirds", {"min_confidence": 1.0})
