"""Boxes of a person in frames in which the detector lost them."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pytest
import torch

from cltransfer.clips.gaps import filled
from cltransfer.clips.persons import Spot, overlap
from cltransfer.features import Features
from cltransfer.pipeline.plan import Plan, Step
from cltransfer.reading.frames import read_frames

NAN = float("nan")


def boxes(*left: float) -> np.ndarray:
    """Boxes by their left edge, all else of them following it; NaN where nobody was seen."""
    return np.array([[x, 2 * x, 10 + x, 20.0 + x - x, 0.5 + x - x] for x in left])


def edges(found: np.ndarray) -> list[float | None]:
    return [None if np.isnan(x) else round(float(x), 6) for x in found[:, 0]]


def test_between_two_sights_the_box_goes_straight() -> None:
    found = filled(boxes(NAN, 4, NAN, NAN, 10, 11), np.array([0.0, 0.1, 0.2, 0.4, 0.7, 0.8]))
    assert edges(found) == [4, 4, 5, 7, 10, 11]
    assert found[2].tolist() == pytest.approx([5, 10, 15, 20, 0])  # the detector did not see it
    assert found[:, 4].tolist() == [0, 0.5, 0, 0, 0.5, 0.5]


@pytest.mark.parametrize(("after", "known"), [(0.9, True), (1.2, False)])
def test_who_is_away_for_long_is_not_guessed(after: float, known: bool) -> None:
    times = np.array([0.0, 0.1, 0.2, 0.3 + after, 0.4 + after])
    found = filled(boxes(0, NAN, NAN, 6, 7), times - np.array([0, 0, 0, 0.3, 0.3]))
    assert edges(found)[1] is not None if known else edges(found) == [0, None, None, 6, 7]


def test_one_frame_between_two_is_filled_however_far_apart_they_are() -> None:
    assert edges(filled(boxes(0, NAN, 4), np.array([0.0, 2.0, 4.0]))) == [0, 2, 4]


def test_at_the_ends_the_box_stays_for_a_moment_or_one_frame() -> None:
    assert edges(filled(boxes(NAN, NAN, NAN, 3, NAN, NAN, NAN), np.arange(7) * 0.2)) == [
        None,
        None,
        3,
        3,
        3,
        None,
        None,
    ]
    assert edges(filled(boxes(NAN, NAN, 3, NAN, NAN), np.arange(5) * 0.1)) == [3, 3, 3, 3, 3]
    assert edges(filled(boxes(NAN, NAN, 3, NAN, NAN), np.arange(5) * 2.0)) == [None, 3, 3, 3, None]


def test_without_times_frames_are_a_twentyfourth_apart() -> None:
    assert edges(filled(boxes(*[NAN] * 9, 3))) == [None] + [3.0] * 9


def test_nobody_is_nobody_and_who_is_seen_is_as_seen() -> None:
    assert edges(filled(boxes(NAN, NAN))) == [None, None]
    assert filled(np.empty((0, 5))).shape == (0, 5)
    seen = boxes(1, 5, 2)
    np.testing.assert_array_equal(filled(seen), seen)


@pytest.mark.parametrize(("aside", "known"), [(0.0, False), (4.0, False), (8.0, True), (50.0, True)])
def test_a_box_is_not_guessed_where_somebody_else_stands(aside: float, known: bool) -> None:
    own, other = boxes(0, NAN, 0, NAN), boxes(0)
    other[:, 0] += aside
    nobody = np.empty((0, 5))
    assert edges(filled(own, found=[own[:1], other, own[2:3], nobody])) == [0, 0 if known else None, 0, 0]


@dataclass(frozen=True)
class Detects:
    """Sees what it is told to, in frames whose shade is their number."""

    found: tuple[np.ndarray, ...]
    requires, provides, family = ("image",), ("box",), "image"

    def persons(self, now: Features) -> Any:
        return [self.found[round(255 * float(image[0, 0, 0]))] for image in now.require("image")]


@dataclass(frozen=True)
class Reads:
    """Finds somebody in every box, whoever it is."""

    requires: ClassVar[tuple[str, ...]] = ("image", "box")
    provides: ClassVar[tuple[str, ...]] = ("keypoints",)
    family: ClassVar[str] = "image"
    doubts_boxes: ClassVar[bool] = True

    def __call__(self, now: Features, before: Features | None) -> Features:
        return replace(now, keypoints=now.require("box")[:, None, [0, 1, 4]].expand(-1, 14, 3))


def test_who_walks_before_the_person_that_is_followed_is_not_read_for_it() -> None:
    own, other = np.tile([40.0, 2, 12, 16, 0.9], (24, 1)), np.tile([0.0, 2, 12, 16, 0.9], (24, 1))
    other[:, 0] = 4 * np.arange(24)
    covered = overlap(own[:1], other)[0] > 0.45
    own[covered | (np.arange(24) == 20)] = np.nan
    found = tuple(seen[np.isfinite(seen[:, 0])] for seen in np.stack([other, own], 1))
    steps = (Step("detector", Detects(found)), Step("pose", Reads()))
    plan = Plan(steps, frozenset({"image"}), frozenset({"box", "keypoints"}), {})
    image = torch.arange(24, dtype=torch.uint8)[:, None, None, None].expand(-1, 3, 18, 108)
    features, _ = read_frames(image, plan, Spot(0, 0.4, 0.5, (108, 18)))
    assert covered.sum() == 3
    assert edges(features.require("keypoints")[:, 0].numpy()) == [None if gone else 40 for gone in covered]
    assert (features.require("box")[:, 4] > 0).tolist() == np.isfinite(own[:, 0]).tolist()
