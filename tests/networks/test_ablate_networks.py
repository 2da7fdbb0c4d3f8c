"""Measuring a result that networks read: what the scene tells of a network is known to the measures too."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import torch

from cltransfer.ablate.measure import measured
from cltransfer.config import load_config
from cltransfer.transfer import Inputs, transfer

SHORT = ("preset=fast", "search_side=48", "output_side=96", "steps=1", "extract.corrections=0", "threads=1")


def test_a_result_is_measured_with_the_shift_of_its_scene_as_it_was_verified(
    networks: tuple[str, ...], blue_network: Path, scene_file: Path, film: Callable[..., Path]
) -> None:
    depth = f"extractors.depth_onnx={{model: {blue_network}, kind: disparity, align: shift, width: 32, height: 16}}"
    config = load_config(overrides=[*networks, *SHORT, depth])
    inputs = Inputs(str(scene_file), str(film("push_in", 2)), subject=scene_file.with_name("subject.json"))
    result = transfer(inputs, config)
    scores = measured(result, inputs.reference, config, config).scores
    assert [term.defined for term in scores.terms if term.name == "filmic_space"] == [2]
    assert [term.name for term in scores.terms] == [term.name for term in result.verified.terms]
    for term, verified in zip(scores.terms, result.verified.terms):
        torch.testing.assert_close(term.values, verified.values, rtol=0, atol=0, equal_nan=True)


def test_what_is_measured_by_another_renderer_is_drawn_by_that(
    networks: tuple[str, ...], scene_file: Path, film: Callable[..., Path]
) -> None:
    """Here by one that draws nothing that is as near as the person."""
    config, blind = (
        load_config(overrides=[*networks, *SHORT, f"renderer.gaussian_splats.near={near}"]) for near in (0.1, 99)
    )
    inputs = Inputs(str(scene_file), str(film("push_in", 2)), subject=scene_file.with_name("subject.json"))
    result = transfer(inputs, config)
    defined = [
        measured(result, inputs.reference, config, by).scores.term("shot_size").defined for by in (config, blind)
    ]
    assert defined == [2, 0]
