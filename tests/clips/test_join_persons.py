"""Who is who where persons cross, hide each other, shake with the camera or leave the frame."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from cltransfer.clips.join_persons import join
from cltransfer.extractors.detect_yolox import all_boxes

FPS = 24.0
TIMES = np.arange(72) / FPS
HEIGHT = 90.0


def standing(x: np.ndarray | float, height: float = HEIGHT, count: int = len(TIMES)) -> np.ndarray:
    """Boxes (N, 4) of a person a third as wide as tall, the middle at ``x``, on one floor."""
    x = np.broadcast_to(x, count)
    size = np.broadcast_to([height / 3, height], (count, 2))
    return np.column_stack([x - size[:, 0] / 2, 400 - size[:, 1], size])


def seen(*persons: np.ndarray, seed: int = 0, noise: float = 0.0, missed: float = 0.0) -> list[np.ndarray]:
    """What a detector finds of persons (N, 4): of two who overlap by half one, the score says by chance or order whom.

    The score's last digits are the person: 0.80 is the first, 0.70 the second.
    """
    rng, found = np.random.default_rng(seed), []
    for boxes in zip(*persons):
        rough = np.stack(boxes) + rng.normal(0, noise * HEIGHT, (len(boxes), 4))
        scores = np.where(rng.random(len(boxes)) < missed, 0, 0.8 - 0.1 * np.arange(len(boxes)))
        found.append(all_boxes(rough, scores, 0.3))
    return found


def whose(found: list[np.ndarray], times: np.ndarray | None = None) -> list[set[int]]:
    """Which persons each track has, the larger tracks first."""
    scores = join(found, times).boxes[..., 4]
    return [{round(8 - 10 * s) for s in row[np.isfinite(row)]} for row in scores]


ORDERS = [[{i} for i in order] for order in itertools.permutations(range(3))]
STEPS = (1, 3, 6, 12)


@pytest.mark.parametrize(("step", "height"), itertools.product(STEPS, (90, 81)))
def test_one_who_walks_past_another_stays_who_they_are(step: float, height: float) -> None:
    for phase in (0, 0.3, 0.6):
        count = 200 // step
        walker, extra = standing(15 + step * (np.arange(count) + phase), count=count), standing(115, height, count)
        assert all(len(of) == 1 for of in whose(seen(walker, extra)))


@pytest.mark.parametrize("pan", [0.0, 60.0, -200.0])
@pytest.mark.parametrize("speed", [60.0, 120.0])
def test_two_who_cross_with_rough_boxes_stay_who_they_are(speed: float, pan: float) -> None:
    swapped = 0
    for seed in range(10):
        going = speed * (TIMES - 1.5)
        found = seen(standing(pan * TIMES + going), standing(pan * TIMES - going, 80), seed=seed, noise=0.015)
        swapped += any(len(of) > 1 for of in whose(found, TIMES))
    assert swapped <= 1  # of 10


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("camera", ["still", "handheld", "pan", "pan begins"])
def test_those_who_stand_together_are_not_confused_by_the_camera(camera: str, seed: int) -> None:
    moves = {
        "still": 0 * TIMES,
        "handheld": 6 * np.sin(10 * TIMES) + 3 * np.sin(25 * TIMES + seed),
        "pan": 300 * TIMES,
        "pan begins": 300 * (TIMES - 1).clip(0),
    }
    one, two, three = (standing(x + moves[camera]) for x in (0, 28, 60))
    assert whose(seen(one, two, three, seed=seed, noise=0.015), TIMES) in ORDERS


def test_one_who_turns_back_or_stops_behind_another_is_found_again() -> None:
    other = standing(100)
    turns, stops = standing(100 - 80 * np.abs(TIMES - 1.5)), standing(60 + 80 * (TIMES - 1).clip(0, 0.85))
    for walker in (turns, stops):
        found = seen(other, walker)
        assert min(len(boxes) for boxes in found) == 1  # hidden for a while
        assert whose(found, TIMES) == [{0}, {1}]


def test_one_whom_the_edge_of_the_frame_cuts_is_passed() -> None:
    extra, walker = standing(8, 85), standing(200 - 90 * TIMES)
    for person in (extra, walker):
        right = person[:, 0] + person[:, 2]
        person[:, 0] = person[:, 0].clip(0)
        person[:, 2] = right - person[:, 0]
    in_frame = int((walker[:, 2] > 5).sum())
    assert whose(seen(extra[:in_frame], walker[:in_frame]), TIMES) == [{1}, {0}]


@pytest.mark.parametrize("more", [(), (700,)])
def test_one_who_comes_back_is_known_again_where_somebody_else_is_missed(more: tuple[int, ...]) -> None:
    walker, others = standing(np.where(TIMES < 1, 100, 120)), [standing(x) for x in (400, *more)]
    found = seen(walker, *others)
    for i in range(20, 28):
        found[i] = found[i][1:]  # hidden, and found again a little aside
    found[28] = np.delete(found[28], 1, axis=0)
    assert whose(found, TIMES) == [{i} for i in range(2 + len(more))]


def test_where_a_person_goes_is_told_by_time() -> None:
    uneven = np.array([0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.55, 0.6, 0.9, 1, 1.1])
    one = standing(100 * uneven, count=11)
    other = standing(150 - 100 * uneven, count=11)
    assert whose(seen(one, other), uneven) == [{0}, {1}]


THINNED = np.arange(24) * 10 / 23


@pytest.mark.parametrize("step", [15, 26, 30, 40])
def test_one_who_walks_more_than_a_width_between_thinned_frames_is_followed(step: float) -> None:
    lead, extra = standing(step * np.arange(24.0), count=24), standing(415, 36, 24)
    found = seen(lead, extra)
    found[12] = found[12][1:]  # missed once
    assert whose(found, THINNED) == [{0}, {1}]
    told = join(found, THINNED).follow(None)[1]
    assert any("jumps in frames 1:" in flag for flag in told) == (step > 15)


@pytest.mark.parametrize(("x", "height"), [(40, 36), (900, 20), (900, 400)])
def test_one_of_another_size_is_another_though_alone_or_near(x: float, height: float) -> None:
    found = [seen(standing(0, count=1))[0], seen(standing(x, height, 1))[0]]
    assert len(join(found, THINNED[:2]).boxes) == 2


def test_who_is_as_near_to_two_is_neither() -> None:
    lead, other = standing(40 * np.arange(2.0), count=2), standing(80 + 40 * np.arange(2.0), count=2)
    assert len(join(seen(lead, other), THINNED[:2]).boxes) == 4  # from 0 and 80 to 40 and 120


def test_a_large_one_who_cannot_be_followed_does_not_give_way_to_a_small_one() -> None:
    places = np.random.default_rng(3).uniform(0, 3000, 24)
    lead, extra = standing(places, count=24), standing(-415, 36, 24)
    found = seen(lead, extra)
    box, told = join(found, np.arange(24) / 24).follow(None)
    np.testing.assert_array_equal(box[:, :4], lead)
    assert told[0] == "person 0 is followed, seen in 24 frames; also seen: 1 in 24 frames"
    assert any("the largest person could not be followed" in flag for flag in told)


def test_of_thousands_who_come_and_go_those_who_are_large_are_kept() -> None:
    count = 80
    lead, places = standing(-500, count=count), np.random.default_rng(0).uniform(0, 10**6, (count, 20))
    crowds = [[lead[i], *(standing(x, 20, 1)[0] for x in row)] for i, row in enumerate(places)]
    persons = join([np.pad(boxes, ((0, 0), (0, 1)), constant_values=0.5) for boxes in crowds])
    assert len(persons.boxes) == 1000
    np.testing.assert_array_equal(persons.boxes[0, :, :4], lead)


def test_one_who_is_lost_in_many_frames_where_others_as_large_come_and_go_is_told() -> None:
    rng = np.random.default_rng(1)
    lead, extra = (
        standing(np.where(np.arange(24) < 16, 50, rng.uniform(1000, 4000, 24)), count=24),
        standing(-415, 36, 24),
    )
    told = join(seen(lead, extra), np.arange(24) / 24).follow(None)[1]
    assert told[0].endswith("in 1 frames and 1 more")
    assert any("somebody as large whom nothing follows is in frames 16, 17" in flag for flag in told)
