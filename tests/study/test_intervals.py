"""Intervals over people hold the truth as often as they say, of six people too, and are found of thousands."""

from __future__ import annotations

import time
import tracemalloc
from itertools import combinations

import numpy as np
import pytest
from scipy.special import expit
from scipy.stats import beta

from cltransfer.study.analysis import bradley_terry, preferences, strengths
from cltransfer.study.answers import Choice
from cltransfer.study.design import QUESTIONS, design
from cltransfer.study.intervals import exact_interval, resampled_interval, share_interval, strength_intervals


@pytest.mark.parametrize("people", [6, 8, 20])
@pytest.mark.parametrize(("likes", "dislikes"), [(7, 3), (90, 10), (9, 1), (1, 1)])
def test_the_interval_of_a_share_holds_the_truth(people: int, likes: int, dislikes: int) -> None:
    """People differ: each prefers the first with a chance of their own, of the mean likes / (likes + dislikes)."""
    rng, counts = np.random.default_rng(1), np.full(people, 10.0)
    held = []
    for _ in range(400):
        low, high = share_interval(rng.binomial(10, rng.beta(likes, dislikes, people)).astype(float), counts)
        held.append(low <= likes / (likes + dislikes) <= high)
    assert np.mean(held) >= 0.92


@pytest.mark.parametrize(
    "counts", [(60, 3, 3, 3, 3, 3), (60, 60, 3, 3, 3, 3), (30, 30, 10, 3, 3, 3), (60,) * 6 + (3,) * 4]
)
@pytest.mark.parametrize(("likes", "dislikes"), [(7, 3), (3, 1), (1, 1)])
def test_the_interval_of_a_share_holds_the_truth_where_some_stop_early(
    counts: tuple[int, ...], likes: int, dislikes: int
) -> None:
    rng, held = np.random.default_rng(1), []
    for _ in range(200):
        wins = rng.binomial(counts, rng.beta(likes, dislikes, len(counts))).astype(float)
        low, high = share_interval(wins, np.array(counts, float))
        held.append(low <= likes / (likes + dislikes) <= high)
    assert np.mean(held) >= 0.92


@pytest.mark.parametrize(("people", "likes", "dislikes"), [(10, 0.45, 0.05), (12, 0.9, 0.1), (12, 1.9, 0.1)])
def test_the_interval_of_a_share_holds_the_truth_where_few_dissent(people: int, likes: float, dislikes: float) -> None:
    rng, counts, held = np.random.default_rng(1), np.full(people, 24.0), []
    for _ in range(300):
        low, high = share_interval(rng.binomial(24, rng.beta(likes, dislikes, people)).astype(float), counts)
        held.append(low <= likes / (likes + dislikes) <= high)
    assert np.mean(held) >= 0.95


@pytest.mark.parametrize("differ", [0.0, 1.5])
def test_the_intervals_of_strengths_hold_the_truth(differ: float) -> None:
    """Six people and eight answers of each pair; the truth is that of very many people."""
    rng, logs = np.random.default_rng(0), np.log([0.6, 0.3, 0.1])

    def asked(people: int, answers: int) -> np.ndarray:
        own, wins = logs + differ * rng.standard_normal((people, 3)), np.zeros((people, 3, 3))
        for i, j in combinations(range(3), 2):
            wins[:, i, j] = rng.binomial(answers, expit(own[:, i] - own[:, j]))
            wins[:, j, i] = answers - wins[:, i, j]
        return wins

    truth, held = bradley_terry(asked(200_000, 1).sum(0)), []
    for _ in range(200):
        wins = asked(6, 8)
        low, high = np.transpose(strength_intervals(wins, bradley_terry(wins.sum(0))))
        held.append((low <= truth) & (truth <= high))
    assert np.mean(held) >= 0.92


def test_intervals_of_six_people_worked_out_by_hand() -> None:
    """Three of them preferred the first in 8 of 10 answers and three in 4, so the share is 0.6.

    Its variance is 6/5 of 6 * 2^2 / 60^2, 0.008; so much have 30 answers, and fewer by Student's t of 59 and of 5.
    """
    wins = np.array([8.0, 8, 8, 4, 4, 4])
    worth = 30 * (2.00100 / 2.57058) ** 2
    ends = beta.ppf(0.025, 0.6 * worth, 0.4 * worth + 1), beta.ppf(0.975, 0.6 * worth + 1, 0.4 * worth)
    assert share_interval(wins, np.full(6, 10.0)) == pytest.approx(ends, abs=1e-5)
    games = np.zeros((6, 2, 2))
    games[:, 0, 1], games[:, 1, 0] = wins, 10 - wins
    half = 2.57058 * 0.008**0.5 / (0.6 * 0.4)  # of the log odds, which change so much faster than the share
    ends = expit(np.log(0.6 / 0.4) - half), expit(np.log(0.6 / 0.4) + half)
    assert strength_intervals(games, np.array([0.6, 0.4]))[0] == pytest.approx(ends, abs=1e-5)


@pytest.mark.parametrize("wins", [(10, 10, 10, 10, 10, 9), (5, 5, 5, 5, 5, 4), (10,) * 6, (0, 1, 0, 0, 0, 0)])
def test_people_who_nearly_agree_know_no_more_than_as_many_answers(wins: tuple[int, ...]) -> None:
    low, high = share_interval(np.array(wins, float), np.full(6, 10.0))
    exact = exact_interval(sum(wins), 60)
    assert low <= exact[0] + 1e-12
    assert high >= exact[1] - 1e-12


def test_people_who_all_agree_count_for_no_more_than_they_are_worth() -> None:
    """Six of whom one answered more than all others together are worth 2.95 who answer equally often: two."""
    counts = np.array([6.0, 1, 1, 1, 1, 1])
    assert share_interval(counts, counts) == pytest.approx((0.025**0.5, 1.0))


def test_one_answer_that_dissents_tells_no_more_than_none() -> None:
    """Of six who gave 24 answers each, five prefer the first throughout; the other way round it is the mirror image."""
    counts, least = np.full(6, 24.0), exact_interval(6, 6)[0]
    for dissent in range(25):
        wins = np.array([24.0] * 5 + [24 - dissent])
        low, high = share_interval(wins, counts)
        assert low <= least + 1e-12
        assert high == 1
        assert share_interval(counts - wins, counts) == pytest.approx((1 - high, 1 - low))
        least = low


def test_participants_are_drawn_anew_with_all_that_they_answered() -> None:
    wins, counts = np.array([9.0, 3, 7, 5, 10, 2, 8, 19, 3]), np.array([10.0, 12, 9, 6, 11, 4, 8, 20, 12])
    people = np.random.default_rng(1).integers(len(wins), size=(20_000, len(wins)))
    low, high = np.quantile(wins[people].sum(1) / counts[people].sum(1), [0.025, 0.975])
    assert resampled_interval(wins, counts) == (pytest.approx(low, abs=0.01), pytest.approx(high, abs=0.01))
    assert resampled_interval(wins, counts) == resampled_interval(wins, counts)


def test_the_interval_of_a_share_holds_what_drawing_participants_anew_gives() -> None:
    """Of six people one answered more than all others together: who leaves that one out finds fewer for the first."""
    wins, counts = np.array([1.0, 1, 1, 0, 1, 20]), np.array([2.0, 1, 1, 1, 1, 20])
    drawn, found = resampled_interval(wins, counts), share_interval(wins, counts)
    assert found[0] <= drawn[0] < drawn[1] <= found[1]


def test_participants_by_the_ten_thousand_are_resampled_in_little_memory() -> None:
    rng, counts = np.random.default_rng(0), np.full(50_000, 9.0)
    wins = rng.binomial(9, 0.6, len(counts)).astype(float)
    tracemalloc.start()
    share_interval(wins, counts)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 32 * 2**20


def test_thousands_of_participants_are_counted_within_seconds() -> None:
    study = design([f"s{i}" for i in range(4)], ["a", "b", "c"], [], 0)
    rng = np.random.default_rng(0)
    choices = []
    for person in range(5_000):
        for item in study.items:
            pair = study.clips[item.first].method, study.clips[item.second].method
            first = int(rng.random() < 0.4)
            choices += [Choice(f"p{person}", item.name, q, pair[first], pair[1 - first]) for q in QUESTIONS]
    start = time.perf_counter()
    shares, values = preferences(choices, study), strengths(choices, study)
    assert time.perf_counter() - start < 10
    assert sum(share.count for share in shares) == len(choices)
    assert all(share.by_participant for share in shares)
    assert all(value.by_participant for value in values)
