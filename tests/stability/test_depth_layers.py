"""Depth that says nothing: flat, without foreground, without background, without either."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
import torch

from cltransfer.features import Features
from cltransfer.registry import LOSSES
from cltransfer.testing import sample_features

MODES = ("robust", "faithful")


def without(features: Features, *gone: int) -> Features:
    layers = features.require("layers").clone()
    layers[:, list(gone)] = False
    return replace(features, layers=layers)


def space(mode: str, reference: Features, rendered: Features) -> torch.Tensor:
    return LOSSES.build("filmic_space", {"mode": mode})(reference, rendered)


@pytest.mark.parametrize("mode", MODES)
def test_flat_depth_is_a_depth(mode: str) -> None:
    features = sample_features(0, 1)
    flat = replace(features, depth=torch.full_like(features.require("depth"), 3.0))
    torch.testing.assert_close(space(mode, flat, flat), torch.zeros(1, dtype=space(mode, flat, flat).dtype))
    assert bool((space(mode, features, flat) > 0).all())


@pytest.mark.parametrize("gone", [(0,), (2,), (0, 2)], ids=["no foreground", "no background", "neither"])
def test_layers_both_sides_lack_cost_nothing_and_one_side_costs(gone: tuple[int, ...]) -> None:
    whole, lacking = sample_features(0, 1), without(sample_features(0, 1), *gone)
    assert float(space("robust", lacking, lacking)) == 0
    assert float(space("robust", whole, lacking)) > 0.5
    assert float(space("robust", lacking, whole)) > 0.5


def test_emptying_a_layer_never_beats_a_layer_a_little_off() -> None:
    features = sample_features(0, 1)
    off = replace(features, depth=features.require("depth") * (1 + 0.1 * features.require("layers")[:, 0]))
    assert float(space("robust", features, off)) < float(space("robust", features, without(features, 0)))


@pytest.mark.parametrize("mode", MODES)
def test_without_the_person_depth_ratios_are_undefined(mode: str) -> None:
    features = sample_features(0, 1)
    assert torch.isnan(space(mode, features, without(features, 1))).all()


@pytest.mark.parametrize("layer", [pytest.param(0, marks=pytest.mark.slow), 1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_reference_without_a_layer_can_be_followed(
    filmed: Callable[..., Any],
    solve: Callable[..., Any],
    edited: Callable[..., str],
    sound: Callable[..., None],
    layer: int,
) -> None:
    reference, _ = filmed("push_in", frames=3)
    found = solve(edited(reference, lambda features: without(features, layer)))
    sound(found)
    assert float(found.verified.term("framing").values.max()) < 0.03
