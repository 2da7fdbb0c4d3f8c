"""What an extractor was given is still there when it is done, and the same: others read it after it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import pytest
import torch

from cltransfer.errors import ModelError
from cltransfer.features import Features
from cltransfer.pipeline.graph import run_clip
from cltransfer.pipeline.plan import Plan, Step
from cltransfer.testing import sample_cameras, sample_features, without_person


@dataclass(frozen=True)
class Deep:
    """An extractor that does something to what it was given, beside its own."""

    spoil: Callable[[Features], Features]
    provides: tuple[str, ...] = ("deep",)
    requires: ClassVar[tuple[str, ...]] = ("image",)
    family: ClassVar[str] = "image"
    whole_clip: bool = False

    def __call__(self, now: Features, before: Features | None) -> Features:
        return self.spoil(now).having("deep", torch.ones(len(now)))

    def read_clip(self, found: Features, load: Callable[[int, int], Features]) -> Features:
        return self(found, None)


def normalised(now: Features) -> Features:
    return replace(now, image=(now.require("image") - 0.45) / 0.22)


def smaller(now: Features) -> Features:
    return replace(now, depth=now.require("depth")[:, ::2, ::2])


def from_elsewhere(now: Features) -> Features:
    return replace(now, camera=sample_cameras(9, len(now)))


def taller(now: Features) -> Features:
    return replace(now, person=replace(now.require("person"), height=3.0))


@pytest.mark.parametrize(
    ("spoil", "name"),
    [
        (normalised, "image"),
        (smaller, "depth"),
        (from_elsewhere, "camera"),
        (taller, "person"),
        (without_person, "box"),
    ],
)
def test_an_extractor_that_gives_back_another_of_what_it_was_given_is_named(spoil: Any, name: str) -> None:
    given, step = sample_features(1, 2), Step("mine", Deep(spoil))
    line = rf"^extractor mine: expected what .* '{name}' is another \(give it .* or name '{name}' in provides\)$"
    with pytest.raises(ModelError, match=line):
        step(given, None)


def test_one_of_whole_clips_is_named_too() -> None:
    given = sample_features(1, 2)
    step = Step("mine", Deep(smaller, whole_clip=True))
    with pytest.raises(
        ModelError, match=r"^extractor mine: expected what it was given and its own, 'depth' is another"
    ):
        run_clip(
            Plan((step,), frozenset({"depth"}), frozenset({"depth", "deep"}), {}), lambda a, b: given[a:b], len(given)
        )


def test_what_an_extractor_provides_it_may_give_anew() -> None:
    given = sample_features(1, 2)
    got = Step("mine", Deep(smaller, provides=("deep", "depth")))(given, None)
    assert got.require("depth").shape == (2, 18, 32)


def test_a_copy_of_what_was_given_is_the_same() -> None:
    given = without_person(sample_features(1, 2))

    def copied(now: Features) -> Features:
        person, camera = now.require("person"), now.require("camera")
        more = {"person": replace(person), "camera": replace(camera, K=camera.K.clone())}
        return replace(now, **more, **{n: now.require(n).clone() for n in ("image", "keypoints", "subject")})

    assert Step("mine", Deep(copied))(given, None).has("deep")


def in_degrees(now: Features) -> Features:
    return replace(now, orientation=torch.rad2deg(now.require("orientation")))


def test_a_clip_that_is_read_in_another_unit_is_refused_with_who_read_it() -> None:
    given, provides = sample_features(1, 2), ("deep", "orientation")
    step = Step("mine", Deep(in_degrees, provides=provides))
    plan = Plan((step,), frozenset({"orientation"}), frozenset({"deep"}), {})
    line = r"^extractor mine: orientation: expected radians, .* \(wrap it, or torch\.deg2rad if these are degrees\)$"
    with pytest.raises(ModelError, match=line):
        run_clip(replace(plan, wanted=frozenset(provides)), lambda a, b: given[a:b], len(given))


def test_a_clip_in_another_unit_is_refused_before_all_of_it_is_read() -> None:
    given, loaded = sample_features(1, 20), []

    def load(start: int, stop: int) -> Features:
        loaded.append((start, stop))
        return given[start:stop]

    step = Step("mine", Deep(in_degrees, provides=("deep", "orientation")))
    for wanted in ({"orientation"}, {"deep"}):  # of what is wanted, and of what only another extractor reads
        loaded.clear()
        with pytest.raises(ModelError, match=r"^extractor mine: orientation: expected radians"):
            run_clip(Plan((step,), frozenset({"orientation"}), frozenset(wanted), {}), load, len(given))
        assert loaded == [(0, 8)]


def test_what_an_extractor_of_whole_clips_reads_in_another_unit_is_refused_too() -> None:
    given = sample_features(1, 2)
    step = Step("mine", Deep(in_degrees, provides=("deep", "orientation"), whole_clip=True))
    plan = Plan((step,), frozenset({"orientation"}), frozenset({"orientation", "deep"}), {})
    with pytest.raises(ModelError, match=r"^extractor mine: orientation: expected radians"):
        run_clip(plan, lambda a, b: given[a:b], len(given))
