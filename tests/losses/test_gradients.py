"""What the README says of a loss as a function: one value a frame, and which features its gradients reach."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from cltransfer import LOSSES
from cltransfer.features import NAMES
from cltransfer.testing import sample_features

REACHED = {
    ("shot_size", "robust"): {"keypoints"},
    ("shot_size", "faithful"): {"keypoints"},
    ("framing", "robust"): {"keypoints"},
    ("framing", "faithful"): {"keypoints"},
    ("camera_angle", "robust"): {"orientation"},
    ("camera_angle", "faithful"): {"orientation"},
    ("camera_movement", "faithful"): {"flow"},
    ("camera_movement", "robust"): set(),
    ("filmic_space", "robust"): set(),
    ("filmic_space", "faithful"): set(),
}


@pytest.mark.parametrize(("name", "mode"), REACHED)
def test_gradients_reach_what_the_readme_says(name: str, mode: str) -> None:
    reference, rendered = sample_features(0, 4), sample_features(1, 4)
    values = {n: getattr(rendered, n) for n in NAMES if isinstance(getattr(rendered, n), Tensor)}
    leaves = {n: value.clone().requires_grad_() for n, value in values.items() if value.is_floating_point()}
    loss = LOSSES.build(name, {"mode": mode})(reference, replace(rendered, **leaves))
    assert loss.shape == (4,)
    assert loss.requires_grad == bool(REACHED[name, mode])
    if loss.requires_grad:
        loss.sum().backward()
    slopes = {n: leaf.grad for n, leaf in leaves.items() if leaf.grad is not None}
    assert slopes.keys() == REACHED[name, mode]
    for slope in slopes.values():
        assert bool(torch.isfinite(slope).all())
        assert bool((slope.flatten(1) != 0).any(1).all())  # of every frame


def test_a_frame_without_a_value_is_left_out_before() -> None:
    reference, rendered = sample_features(0, 4), sample_features(1, 4)
    reference.require("flow")[0] = torch.nan
    loss, flow = LOSSES.build("camera_movement", {"mode": "faithful"}), rendered.require("flow").clone()
    flow[0] = torch.nan
    for start, frames in ((0, [False, True, True, True]), (1, [True] * 4)):
        leaf = flow.clone().requires_grad_()
        loss(reference[start:], replace(rendered, flow=leaf)[start:]).nansum().backward()
        assert leaf.grad is not None
        assert leaf.grad.isfinite().flatten(1).all(1).tolist() == frames
