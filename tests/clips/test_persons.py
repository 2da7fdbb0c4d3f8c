"""Persons along a clip: one id through gaps and crossings, and doubts are said."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import torch

from cltransfer.clips.join_persons import join
from cltransfer.clips.persons import Persons, Spot, overlap
from cltransfer.config import load_config
from cltransfer.errors import ModelError, UsageError
from cltransfer.extractors.detect_yolox import all_boxes
from cltransfer.features import Features
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.plan import Plan, Step
from cltransfer.reading.frames import read_frames


def walk(start: float, step: float, frames: int, width: float = 20.0) -> np.ndarray:
    """Boxes (N, 5) of a person who walks to the right."""
    x = start + step * np.arange(frames)
    return np.stack([x, np.full(frames, 10.0), np.full(frames, width), np.full(frames, 3 * width), np.ones(frames)], 1)


def frames_of(*persons: np.ndarray) -> list[np.ndarray]:
    """What a detector finds, in changing order; NaN rows are not found."""
    rows = zip(*persons)
    found = [np.stack(row)[:: -1 if i % 2 else 1] for i, row in enumerate(rows)]
    return [boxes[np.isfinite(boxes[:, 0])] for boxes in found]


def test_the_largest_is_person_0_in_whatever_order_they_are_found() -> None:
    small, large = walk(0, 3, 12, 10), walk(200, -3, 12, 30)
    persons = join(frames_of(small, large))
    np.testing.assert_array_equal(persons.boxes, [large, small])
    box, flags = persons.follow(None)
    np.testing.assert_array_equal(box, large)
    assert flags == ("person 0 is followed, seen in 12 frames; also seen: 1 in 12 frames",)
    np.testing.assert_array_equal(persons.follow(1)[0], small)


def test_a_click_follows_who_covers_it_and_of_two_the_smaller() -> None:
    large, small = walk(0, 0, 8, 100), walk(40, 2, 8, 10)
    persons = join(frames_of(large, small))
    np.testing.assert_array_equal(persons.follow(Spot(2, 0.046, 0.02, (1000, 1000)))[0], small)  # both cover it
    np.testing.assert_array_equal(persons.follow(Spot(2, 0.09, 0.02, (1000, 1000)))[0], large)
    with pytest.raises(
        UsageError, match=r"nobody at 0.3,0.02 of frame 2 .seen there: person 0, x 0.00 to 0.10, y 0.01 to 0.31; p"
    ):
        persons.follow(Spot(2, 0.3, 0.02, (1000, 1000)))


def test_a_click_between_two_frames_is_told_and_refused_where_they_show_others() -> None:
    left, right = walk(0, 5, 12), walk(200, 5, 12, 10)
    persons = join(frames_of(left, right))
    size = (1000, 1000)
    place = (left[4, 0] + 6) / 1000
    box, flags = persons.follow(Spot(4, place, 0.02, size, other=5))
    np.testing.assert_array_equal(box, left)
    assert flags[0] == "the moment of the click lies between frames 4 and 5: who is there in frame 4 is taken"
    assert not any("click" in flag for flag in persons.follow(Spot(4, place, 0.02, size))[1])
    passed = join(frames_of(walk(0, 0, 12), walk(200, 0, 12, 10)))
    passed.boxes[:, 5] = passed.boxes[::-1, 5]
    with pytest.raises(
        UsageError, match=r"0\.005,0\.02 shows person 0 in frame 4 and person 1 in frame 5 \(#person=0 or"
    ):
        passed.follow(Spot(4, 0.005, 0.02, size, other=5))


def test_a_click_on_a_frame_without_anybody_says_so() -> None:
    lone = walk(0, 1, 6)
    lone[3] = np.nan
    with pytest.raises(UsageError, match="seen there: nobody"):
        join(frames_of(lone)).follow(Spot(3, 0.005, 0.02, (1000, 1000)))
    with pytest.raises(UsageError, match="#person=1: nobody is seen"):
        join([np.zeros((0, 5))] * 4).follow(1)
    with pytest.raises(UsageError, match="seen there: nobody"):
        join([np.zeros((0, 5))] * 4).follow(Spot(3, 0.005, 0.02, (1000, 1000)))


def test_a_gap_keeps_the_id_and_has_no_box() -> None:
    one, other = walk(0, 1, 20), walk(300, 1, 20, 10)
    one[5:10] = np.nan
    persons = join(frames_of(one, other))
    np.testing.assert_array_equal(persons.boxes[0], one)


def test_one_who_comes_after_an_empty_stretch_is_another() -> None:
    first, second = walk(0, 2, 30), walk(0, 2, 30, 12)
    first[10:] = np.nan
    second[:20] = np.nan
    assert np.isfinite(join(frames_of(first, second)).boxes[..., 0]).sum(1).tolist() == [10, 10]


@pytest.mark.parametrize(("share", "told"), [(0.8, True), (0.3, False)])
def test_who_is_about_as_large_and_seen_briefly_may_be_the_one_who_is_lost(share: float, told: bool) -> None:
    boxes, nobody = np.full((13, 24, 5), np.nan), ((),) * 13
    boxes[0, :12] = walk(0, 1, 12)
    for i in range(12):  # one a frame, never the same
        boxes[1 + i, 12 + i] = walk(300, 0, 1)[0] * [1, 1, share, 1, 1]
    flags = Persons(boxes, nobody, nobody, nobody).follow(0)[1]
    assert any(flag.startswith("somebody as large whom nothing follows") for flag in flags) == told


@pytest.mark.parametrize("fps", [2.4, 24, 60])
def test_how_long_one_may_be_unseen_is_told_by_time(fps: float) -> None:
    lone, count = walk(50, 30 / fps, 240), max(1, int(fps * 0.8))
    lone[100 : 100 + count] = np.nan
    box, flags = join(frames_of(lone), np.arange(240) / fps).follow(None)
    np.testing.assert_array_equal(box, lone)
    assert flags == ()


def test_one_alone_who_is_back_after_long_is_the_same_if_place_and_size_fit_and_told() -> None:
    times = np.arange(200) / 24
    lone, shrunk, elsewhere = walk(50, 0.1, 200), walk(50, 0.1, 200), walk(50, 0.1, 200)
    shrunk[100:, 2:4] *= 0.5
    elsewhere[100:, 0] += 50
    for person in (lone, shrunk, elsewhere):
        person[50:100] = np.nan
    box, flags = join(frames_of(lone), times).follow(None)
    np.testing.assert_array_equal(box, lone)
    assert flags == ("after long the person is seen again in frames 100: it may be another",)
    assert [len(join(frames_of(person), times).boxes) for person in (shrunk, elsewhere)] == [2, 2]
    assert len(join(frames_of(lone, walk(400, 0, 200)), times).boxes) == 3  # others are there
    assert len(join(frames_of(lone), times * 3).boxes) == 2  # too long ago


def test_a_crossing_is_told() -> None:
    one, other = walk(0, 4, 30), walk(116, -4, 30)
    persons = join(frames_of(one, other))
    np.testing.assert_array_equal(persons.boxes, [one, other])  # each keeps to their own way
    assert any("who is who is not certain" in flag for flag in persons.follow(0)[1])


def test_one_of_two_who_is_hidden_by_the_other_is_told() -> None:
    hidden, before = walk(40, 0, 8), walk(0, 12, 8)  # the second walks in front of the first, who is seen no more
    hidden[3:] = np.nan
    _, flags = join(frames_of(hidden, before)).follow(0)
    assert "persons overlap in frames 3: who is who is not certain" in flags
    apart = walk(200, 0, 8)
    apart[3:] = np.nan
    assert not any("not certain" in flag for flag in join(frames_of(apart, before)).follow(0)[1])


def test_one_alone_who_jumps_is_the_same_and_told() -> None:
    lone = walk(0, 2, 10)
    lone[6:, 0] += 300
    box, flags = join(frames_of(lone)).follow(None)
    np.testing.assert_array_equal(box, lone)
    assert flags == ("the person jumps in frames 6: it may be another",)


def test_nobody_is_no_box_and_no_flag() -> None:
    box, flags = join([np.empty((0, 5))] * 4).follow(None)
    assert np.isnan(box).all()
    assert box.shape == (4, 5)
    assert flags == ()


def test_a_person_who_is_not_there_cannot_be_followed() -> None:
    with pytest.raises(UsageError, match=r"#person=1: only person 0 is seen in this clip$"):
        join(frames_of(walk(0, 1, 4))).follow(1)
    with pytest.raises(UsageError, match=r"#person=2: expected 0 to 1: 2 persons are seen$"):
        join(frames_of(walk(0, 1, 4), walk(200, 1, 4))).follow(2)
    with pytest.raises(UsageError, match=r"^b.mp4: #person=1: only person 0"):
        join(frames_of(walk(0, 1, 4))).follow(1, "b.mp4")
    with pytest.raises(UsageError, match=r"#person=1: nobody is seen$"):
        join([np.zeros((0, 5))] * 4).follow(1)


def test_overlap_is_intersection_over_union() -> None:
    boxes = np.array([[0.0, 0, 2, 2], [1, 0, 2, 2], [5, 5, 1, 1]])
    np.testing.assert_allclose(overlap(boxes[:1], boxes), [[1, 1 / 3, 0]])


def test_one_person_seen_by_several_cells_is_one_box() -> None:
    boxes = np.array([[0.0, 0, 10, 30], [1, 0, 10, 30], [50, 0, 10, 30], [80, 0, 10, 30]])
    found = all_boxes(boxes, np.array([0.7, 0.9, 0.5, 0.1]), 0.3)
    np.testing.assert_allclose(found, [[1, 0, 10, 30, 0.9], [50, 0, 10, 30, 0.5]])
    assert all_boxes(boxes, np.zeros(4), 0.3).shape == (0, 5)


@pytest.mark.parametrize("who", [1, Spot(0, 0.5, 0.5, (32, 18))])
def test_whom_to_follow_is_no_question_where_nobody_is_told_apart(who: int | Spot) -> None:
    parts = Components.build(load_config())
    plan = parts.plan("image").person_known
    with pytest.raises(UsageError, match=r"#person: no extractor in use tells persons apart .*and a loss that asks"):
        read_frames(torch.zeros(2, 3, 18, 32, dtype=torch.uint8), plan, who)


@dataclass(frozen=True)
class Detects:
    """Gives whatever it is told to for all frames."""

    found: Any
    requires, provides, family = ("image",), ("box",), "image"

    def persons(self, now: Features) -> Any:
        if isinstance(self.found, Exception):
            raise self.found
        return self.found


@pytest.mark.parametrize(
    ("found", "told"),
    [
        (IndexError("none"), "expected box, it raised IndexError: none"),
        (None, r"expected an array \(P, 5\) of persons for each of 2 frames, got a NoneType$"),
        ([np.zeros((1, 5))], r"got 1 of them: ndarray \(1, 5\)$"),
        ([np.zeros((1, 5)), np.zeros((1, 4))], r"got 2 of them: ndarray \(1, 4\), ndarray \(1, 5\)$"),
        ([torch.zeros(1, 5)] * 2, r"got 2 of them: Tensor \(1, 5\)$"),
    ],
)
def test_a_detector_that_gives_something_else_is_named(found: Any, told: str) -> None:
    plan = Plan((Step("mine", Detects(found)),), frozenset({"image"}), frozenset({"box"}), {})
    with pytest.raises(ModelError, match=f"extractor mine: .*{told}"):
        read_frames(torch.zeros(2, 3, 18, 32, dtype=torch.uint8), plan, None)
