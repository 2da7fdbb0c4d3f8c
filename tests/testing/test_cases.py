"""A contract case says what it lacks, instead of failing somewhere inside a component."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import pytest
import torch

from cltransfer.features import Features
from cltransfer.testing import ExtractorCase


@dataclass(frozen=True)
class Drift:
    """How far the box has moved since the first frame of the clip."""

    family: ClassVar[str] = "image"
    requires: ClassVar[tuple[str, ...]] = ("image", "box")
    provides: ClassVar[tuple[str, ...]] = ("drift",)
    whole_clip: ClassVar[bool] = True

    def read_clip(self, found: Features, load: Callable[[int, int], Features]) -> Features:
        assert load(0, 1).require("image").shape[0] == 1
        box = found.require("box")
        return found.having("drift", box[:, 0] - box[0, 0])


class TestAnExtractorOfWholeClips(ExtractorCase):
    component = Drift()


@dataclass(frozen=True)
class Deep:
    """What a network sees in an image made as it was trained, which it leaves behind for all that is read later."""

    leaves: str = "image"
    family: ClassVar[str] = "image"
    requires: ClassVar[tuple[str, ...]] = ("image",)
    provides: ClassVar[tuple[str, ...]] = ("deep",)

    def __call__(self, now: Features, before: Features | None) -> Features:
        seen = (now.require("image") - 0.45) / 0.22
        return now.having(self.leaves, seen).having("deep", seen.flatten(1).mean(1))


def test_an_extractor_that_leaves_another_image_behind_is_found_out() -> None:
    class OfDeep(ExtractorCase):
        component: ClassVar[Any] = Deep()

    OfDeep().test_changes_nothing_in_place()
    OfDeep().test_provides_what_it_says()
    with pytest.raises(AssertionError, match=r"^image is another: give it a name of its own, or name it in provides"):
        OfDeep().test_leaves_what_it_was_given()
    OfDeep.component = Deep(leaves="deep")
    OfDeep().test_leaves_what_it_was_given()


@dataclass(frozen=True)
class Tracker:
    """Joints as parts of the frame, as trackers give them, or as pixels."""

    per: tuple[int, int] = (1, 1)
    family: ClassVar[str] = "image"
    requires: ClassVar[tuple[str, ...]] = ("image",)
    provides: ClassVar[tuple[str, ...]] = ("keypoints",)

    def __call__(self, now: Features, before: Features | None) -> Features:
        joints = (
            torch.linspace(0.2, 0.8, 14)[None, :, None] + now.require("image").flatten(1).mean(1)[:, None, None] / 9
        )
        return now.having("keypoints", joints * torch.tensor([*self.per, 1.0]))


def test_an_extractor_of_another_unit_is_found_out() -> None:
    class OfTracker(ExtractorCase):
        component: ClassVar[Any] = Tracker()

    OfTracker().test_provides_what_it_says()
    with pytest.raises(AssertionError, match=r"^keypoints: expected pixels of a frame of 64 x 36, got .*\(multiply x"):
        OfTracker().test_values_are_of_the_features_units()
    OfTracker.component = Tracker(per=(64, 36))
    OfTracker().test_values_are_of_the_features_units()


@dataclass(frozen=True)
class Flicker:
    """How much brighter a frame is than the one before, which has to be one for each."""

    provides: ClassVar[tuple[str, ...]] = ("flicker",)
    requires: ClassVar[tuple[str, ...]] = ("image",)
    family: ClassVar[str] = "image"
    needs_before: ClassVar[bool] = True

    def __call__(self, now: Features, before: Features | None) -> Features:
        assert before is not None
        pairs = zip(now.require("image"), before.require("image"))
        return now.having("flicker", torch.stack([(a - b).mean() for a, b in pairs])[:, None])


class OneForEach(ExtractorCase):
    component: ClassVar[Any] = Flicker()


def test_an_extractor_that_wants_a_frame_before_for_each_is_told_before_a_search_asks_it() -> None:
    OneForEach().test_batch_equals_single()
    with pytest.raises(Exception, match=r"one number of frames|index 1"):
        OneForEach().test_one_frame_before_serves_a_batch()


@dataclass(frozen=True)
class Faster(Flicker):
    provides = ("faster",)  # type: ignore[misc]


class Undecorated(Flicker):
    gain: float = 2.0


def test_a_class_whose_options_are_its_base_s_is_found_out() -> None:
    class OfFaster(ExtractorCase):
        component: ClassVar[Any] = Faster()

    OfFaster().test_is_frozen_dataclass()
    OfFaster.component = Undecorated()
    with pytest.raises(AssertionError, match=r"^expected @dataclass\(frozen=True\).*Undecorated has that of its base"):
        OfFaster().test_is_frozen_dataclass()


@dataclass(frozen=True)
class Glance:
    """How bright a frame is, for the box of its person, which it does not say that it reads."""

    uses: tuple[str, ...] = ()
    provides: ClassVar[tuple[str, ...]] = ("glance",)
    requires: ClassVar[tuple[str, ...]] = ("image",)
    family: ClassVar[str] = "image"

    def __call__(self, now: Features, before: Features | None) -> Features:
        bright = now.require("image").flatten(1).mean(1)
        return now.having("glance", bright * now.require("box")[:, 2].float() if now.has("box") else bright)


def test_an_extractor_whose_values_are_of_what_it_does_not_declare_is_found_out() -> None:
    class OfGlance(ExtractorCase):
        component: ClassVar[Any] = Glance()

    with pytest.raises(AssertionError, match="not close"):
        OfGlance().test_declared_features_suffice()
    OfGlance.component = Glance(uses=("box",))
    OfGlance().test_declared_features_suffice()
