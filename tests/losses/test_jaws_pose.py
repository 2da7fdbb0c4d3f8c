"""JAWS' loss of pose against loops, and what its switch changes."""

from dataclasses import replace
from types import ModuleType
from typing import Any

import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode

from cltransfer.features import Features
from cltransfer.losses import jaws_pose
from cltransfer.losses.framing import Framing
from cltransfer.losses.jaws_pose import JawsPose
from cltransfer.losses.shot_size import ShotSize
from cltransfer.testing import LossCase, sample_features

WIDTH, HEIGHT, SPREAD = 30, 20, 1.5
TEMPERATURE = 12.0  # lower than JAWS' 200, so that every joint has a say


@pytest.fixture
def small_maps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Maps that a loop gets through."""
    for name, value in (("HEIGHT", HEIGHT), ("SPREAD", SPREAD), ("TEMPERATURE", TEMPERATURE)):
        monkeypatch.setattr(jaws_pose, name, value)


def joints(seed: int, count: int = 14) -> Features:
    """Frames of ``count`` joints in all, which may be out of them, or hardly be seen."""
    random = torch.Generator().manual_seed(seed)
    scale = torch.tensor([1.2 * WIDTH, 1.2 * HEIGHT, 1.0])
    places = (torch.rand(1, count, 3, generator=random) * scale).double()
    return Features((WIDTH, HEIGHT), keypoints=places.view(-1, 14, 3))


class TestQuirkyPose(LossCase):
    component = JawsPose(quirks=True)


@pytest.mark.parametrize("quirks", [False, True])
@pytest.mark.parametrize("seed", range(2))
def test_pose_is_the_published_formula(small_maps: None, literal: ModuleType, seed: int, quirks: bool) -> None:
    reference, rendered = joints(2 * seed), joints(2 * seed + 1)
    lists = [f.keypoints[0].tolist() for f in (reference, rendered)]
    expected = literal.pose(*lists, WIDTH, HEIGHT, SPREAD, TEMPERATURE, quirks)
    got = JawsPose(quirks=quirks)(reference, rendered)
    torch.testing.assert_close(got, torch.tensor([expected], dtype=torch.float64), rtol=1e-5, atol=1e-8)


def test_a_joint_the_reference_hardly_shows_hardly_counts() -> None:
    reference, rendered = sample_features(1, 1), sample_features(2, 1)
    reference.keypoints[..., 2] = 1.0
    hidden = reference.keypoints.clone()
    hidden[:, 5, 2] = 0.0
    both = jaws_pose.sharpness(torch.cat([reference.keypoints, hidden]), reference.size)
    assert both[0, 5] > 0.3
    assert both[1, 5] == 0
    torch.testing.assert_close(both.sum(1), torch.full((2,), 14.0, dtype=torch.float64))
    shown = JawsPose()(reference, rendered)
    assert JawsPose()(replace(reference, keypoints=hidden), rendered) != shown


class Largest(TorchDispatchMode):
    """Elements of the largest tensor that is made."""

    def __init__(self) -> None:
        super().__init__()
        self.elements = 0

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        made = func(*args, **(kwargs or {}))
        if isinstance(made, torch.Tensor):
            self.elements = max(self.elements, made.numel())
        return made


def test_maps_are_drawn_of_a_few_frames_at_a_time() -> None:
    reference, rendered = (
        Features((WIDTH, HEIGHT), keypoints=joints(i, 14 * 41).keypoints.view(41, 14, 3)) for i in (0, 1)
    )
    with Largest() as largest:
        losses = JawsPose()(reference, rendered)
    assert largest.elements <= 4 * 14 * 224 * 336
    each = torch.cat([JawsPose()(reference[i : i + 1], rendered[i : i + 1]) for i in range(41)])
    torch.testing.assert_close(losses, each, rtol=1e-12, atol=0)


def test_an_arm_that_hangs_otherwise_costs_though_size_and_framing_are_the_same() -> None:
    """What the paper holds against JAWS (Sec. 4.2.1)."""
    reference = sample_features(1, 1)
    moved = reference.keypoints.clone()
    moved[:, 4:6, 1] -= 10
    rendered = replace(reference, keypoints=moved)
    assert float(JawsPose()(reference, rendered)) > 0.5
    assert float(ShotSize()(reference, rendered)) == float(Framing()(reference, rendered)) == 0


def test_pose_has_a_slope_where_maps_do_not_overlap() -> None:
    """The cumulative sums reach across the frame, so a far joint is drawn near."""
    reference = sample_features(1, 1)
    costs = []
    for shift in (8.0, 16.0, 24.0):
        away = reference.keypoints + torch.tensor([shift, 0.0, 0.0])
        costs.append(float(JawsPose()(reference, replace(reference, keypoints=away))))
    assert costs[0] < costs[1] < costs[2]


def test_pose_is_computed_where_the_features_are() -> None:
    features = sample_features(0, 2)
    elsewhere = replace(features, keypoints=features.require("keypoints").to("meta"))
    assert JawsPose()(elsewhere, elsewhere).device.type == "meta"


def test_nobody_in_the_reference_is_undefined() -> None:
    reference, rendered = sample_features(1, 1), sample_features(2, 1)
    reference.keypoints[..., 2] = 0
    assert JawsPose()(reference, rendered).isnan().all()


def test_a_person_out_of_the_frame_costs_less_than_the_penalty() -> None:
    reference, rendered = sample_features(1, 8), sample_features(2, 8)
    rendered.keypoints[..., 2] = 0
    assert float(JawsPose()(reference, rendered).max()) < JawsPose.penalty
