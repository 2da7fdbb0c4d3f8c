"""Whether a clip zooms is told by its flow and depth, and by its cameras where they are known, as of a scene."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import pytest

from cltransfer.config import load_config
from cltransfer.driver.stage import Stage, read_path
from cltransfer.features import Features
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.objective import Objective
from cltransfer.reading.reference import Reading, read_reference
from cltransfer.reading.zoom import lens_range
from cltransfer.scenes.load import load_scene
from cltransfer.shots import shot

FRAMES = 12
ZOOMS = {"zoom": 0.69, "crash_zoom": 1.10, "dolly_zoom": 0.82}  # log of how far the lens goes


def read(name: str) -> Features:
    scene, parts = load_scene("builtin:plaza"), Components.build(load_config())
    assert scene.subject is not None
    path = shot(name, scene.subject, (160, 90), FRAMES).camera
    return read_path(Stage(scene, parts.renderer, parts.plan("scene"), Objective(parts.losses), (160, 90)), path)


@pytest.mark.parametrize("name", [*ZOOMS, "push_in", "pull_out", "pan", "tilt", "boom", "truck", "static", "dutch"])
def test_a_zoom_is_told_from_all_else(name: str) -> None:
    features = read(name)
    told = lens_range(features)
    if name in ZOOMS:
        assert 0.6 * ZOOMS[name] < told < 1.1 * ZOOMS[name]
    else:
        assert told < 0.3
    assert lens_range(replace(features, camera=None)) == told


@pytest.mark.parametrize("family", ["scene", "image"])
def test_of_a_scene_the_lens_itself_is_known(mean_flow: tuple[str, ...], family: Literal["scene", "image"]) -> None:
    parts = Components.build(load_config(overrides=list(mean_flow)))
    for name, log in (("zoom", ZOOMS["zoom"]), ("pan", 0.0)):
        found = read_reference(f"builtin:{name}", parts, Reading(FRAMES, 64, family))
        assert found.zoom == pytest.approx(math.exp(log), abs=0.01)
        assert found.features.camera is None


def test_where_nothing_tells_it_is_not_known() -> None:
    features = read("zoom")
    assert math.isnan(lens_range(replace(features, depth=None)))
    assert math.isnan(lens_range(features[:1]))
    assert math.isnan(lens_range(replace(features, layers=features.require("layers") & False)))
