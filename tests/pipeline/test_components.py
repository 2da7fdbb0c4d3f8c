"""What a config builds: a loss or an extractor that asks for what no one can give is refused at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import pytest

from cltransfer.config import load_config
from cltransfer.errors import ModelError, UsageError
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.plan import Plan, Step
from cltransfer.registry import EXTRACTORS, LOSSES

MINE = ["losses.mine={}"]


def method(*arguments: object) -> None:
    """Stands for any method."""


@pytest.fixture
def loss() -> Iterator[Callable[..., None]]:
    """Registers a loss ``mine`` that asks for features; it is forgotten after the test."""

    def register(*requires: str, uses: tuple[str, ...] = ()) -> None:
        own = {"requires": requires, "uses": uses, "unit": "frame", "penalty": 1.0, "__call__": method}
        LOSSES.register("mine")(_frozen({**own, "__annotations__": {"weight": float}, "weight": 1.0}))

    yield register
    LOSSES._classes.pop("mine", None)


@pytest.fixture
def extractor() -> Iterator[Callable[..., None]]:
    """Registers an extractor ``gazer`` of ``gaze``; it is forgotten after the test."""

    def register(*requires: str) -> None:
        own = {"requires": requires, "provides": ("gaze",), "family": "image", "__call__": method}
        EXTRACTORS.register("gazer")(_frozen(own))

    yield register
    EXTRACTORS._classes.pop("gazer", None)


def _frozen(body: dict[str, Any]) -> type[Any]:
    return dataclass(frozen=True)(type("Mine", (), body))


@pytest.mark.parametrize("how", ["requires", "uses"])
def test_a_loss_that_asks_for_no_feature_is_refused_with_what_was_meant(loss: Callable[..., None], how: str) -> None:
    loss("keypoint") if how == "requires" else loss("flow", uses=("keypoint",))
    with pytest.raises(ModelError) as caught:
        Components.build(load_config(overrides=MINE))
    line = "expected a feature or what an extractor provides (did you mean 'keypoints'?)"
    assert str(caught.value) == f"loss 'mine': {how} 'keypoint', {line}"


@pytest.mark.parametrize("name", ["camera", "person"])
def test_a_loss_that_asks_for_what_no_reference_has_is_refused(loss: Callable[..., None], name: str) -> None:
    loss(name)
    with pytest.raises(ModelError) as caught:
        Components.build(load_config(overrides=MINE))
    told = f"loss 'mine': requires {name!r}, which no reference has (read it in a scene extractor)"
    assert str(caught.value) == told


def test_an_extractor_that_asks_for_no_feature_is_refused(extractor: Callable[..., None]) -> None:
    extractor("imgae")
    with pytest.raises(ModelError, match=r"^extractor 'gazer': requires 'imgae', .* \(did you mean 'image'\?\)$"):
        Components.build(load_config(overrides=["extractors.gazer={}"]))


def test_what_a_plugin_provides_is_a_feature_whether_it_is_in_the_config_or_not(
    loss: Callable[..., None], extractor: Callable[..., None]
) -> None:
    loss("gaze", uses=("depth_confidence",))
    with pytest.raises(ModelError, match="requires 'gaze', expected a feature"):
        Components.build(load_config(overrides=MINE))
    extractor("image")
    for more in ([], ["extractors.gazer={}"]):
        assert "mine" in Components.build(load_config(overrides=[*MINE, *more])).losses


def test_the_extractor_of_a_plugin_that_would_give_what_is_missing_is_named(
    loss: Callable[..., None], extractor: Callable[..., None]
) -> None:
    loss("gaze")
    extractor("image")
    for family in ("image", "scene"):
        missing = {
            bool(more): Components.build(load_config(overrides=[*MINE, *more])).plan(family).missing
            for more in ([], ["extractors.gazer={}"])
        }
        assert missing[False]["gaze"] == f"no {family} extractor provides 'gaze' (extractors.gazer={{}} does)"
        assert "gaze" not in missing[True]
    EXTRACTORS.get("gazer").family = "scene"  # of which a clip has none
    parts = Components.build(load_config(overrides=MINE))
    assert parts.plan("image").missing["gaze"] == "no image extractor provides 'gaze'"


def test_what_compares_neighbouring_frames_is_told_by_the_extractors_not_by_a_name(
    loss: Callable[..., None], extractor: Callable[..., None]
) -> None:
    loss("gaze")
    extractor("image")
    parts = Components.build(load_config(overrides=[*MINE, "extractors.gazer={}"]))
    assert parts.objective.moving == {"flow", "flow_confidence"}
    assert parts.objective.of_motion.tolist() == [name == "camera_movement" for name in parts.losses]
    for changed in ({"needs_before": True}, {"requires": ("flow",)}):
        gazer = type("Gazer", (), {"provides": ("gaze",), "requires": ("image",), **changed})()
        moved = replace(parts, extractors={**parts.extractors, "gazer": gazer})
        assert moved.objective.moves(moved.losses["mine"])
    whole = type("Gazer", (), {"provides": ("gaze",), "requires": ("flow",), "whole_clip": True})()
    moved = replace(parts, extractors={**parts.extractors, "gazer": whole})
    assert not moved.objective.moves(moved.losses["mine"])
    glancer = type("Glancer", (), {"provides": ("glance",), "requires": ("flow",)})()
    gazer = type("Gazer", (), {"provides": ("gaze",), "requires": ("glance",)})()
    moved = replace(parts, extractors={**parts.extractors, "gazer": gazer, "glancer": glancer})  # in any order
    assert moved.objective.moves(moved.losses["mine"])


def test_an_extractor_of_whole_clips_is_refused_with_what_a_search_does_without_it(loss: Callable[..., None]) -> None:
    whole = {"requires": ("image",), "family": "image", "whole_clip": True, "read_clip": method}
    drift, told = _frozen({**whole, "provides": ("drift",)})(), r"^extractor drift: reads a whole clip, .* \(%s"
    loss("drift")
    EXTRACTORS.register("drift")(type(drift))
    try:
        parts = Components.build(load_config(overrides=[*MINE, "extractors.drift={}"]))
    finally:
        EXTRACTORS._classes.pop("drift")
    shared = parts.plan("image").wanted
    without = r"leave out losses\.mine, which `evaluate` takes, or provide 'drift' by a scene extractor\)$"
    for family in ("scene", "image"):
        with pytest.raises(UsageError, match=told % without):
            parts.check_single(family, shared)
    known = _frozen({"requires": ("person",), "family": "scene", "provides": ("drift",), "__call__": method})()
    beside = replace(parts, extractors={**parts.extractors, "known": known})
    beside.check_single("scene", shared)
    with pytest.raises(UsageError, match=told % r"use extract\.inner=geometric\)$"):
        beside.check_single("image", shared)


def test_of_a_clip_without_depth_what_would_read_it_is_named() -> None:
    told = Components.build(load_config()).plan("image").missing["depth"]
    assert told.startswith("no image extractor provides 'depth' (extractors.depth_sfm={} does")
    by_sfm = Components.build(load_config(overrides=["extractors.depth_sfm={}"])).plan("image")
    assert "depth" not in by_sfm.missing


def test_an_extractor_whose_options_tell_what_it_provides_stands_beside_a_slip(loss: Callable[..., None]) -> None:
    chosen = property(lambda self: (self.give,))
    own = {"requires": ("image",), "provides": chosen, "family": "image", "__call__": method, "give": "gaze"}
    loss("gazes")
    EXTRACTORS.register("gazer")(_frozen({**own, "__annotations__": {"give": str}}))
    try:
        with pytest.raises(ModelError, match=r"requires 'gazes', .* \(did you mean 'gaze'\?\)$"):
            Components.build(load_config(overrides=[*MINE, "extractors.gazer={}"]))
    finally:
        EXTRACTORS._classes.pop("gazer")


@dataclass(frozen=True)
class ReadsBoxes:
    doubts_boxes: bool = True

    family: ClassVar[str] = "image"
    requires: ClassVar[tuple[str, ...]] = ("image", "box")
    provides: ClassVar[tuple[str, ...]] = ("keypoints",)


@pytest.mark.parametrize(
    ("readers", "guessed"), [((), False), ((True,), True), ((True, False), False), ((True, True), True)]
)
def test_boxes_are_guessed_only_for_readers_that_all_say_of_one_that_nobody_is_in_it(
    readers: tuple[bool, ...], guessed: bool
) -> None:
    """One that cannot would find joints in every frame in which the detector lost the person."""
    steps = tuple(Step(f"reader {i}", ReadsBoxes(doubts)) for i, doubts in enumerate(readers))
    assert Plan(steps, frozenset(), frozenset(), {}).doubts_boxes == guessed
