"""Means with bootstrap intervals, and when a difference is certain."""

from __future__ import annotations

import json
from dataclasses import asdict

import numpy as np
import pytest

from cltransfer.paired import estimate, wilcoxon_p


def test_the_interval_holds_the_mean_and_does_not_depend_on_the_hour() -> None:
    values = list(np.random.default_rng(3).normal(5, 1, 40))
    first, again = estimate(values), estimate(values)
    assert first == again
    assert first.low is not None
    assert first.high is not None
    assert first.low < np.mean(values) < first.high
    assert first.high - first.low == pytest.approx(2 * 1.96 * np.std(values) / 40**0.5, rel=0.1)


def test_the_interval_covers_the_truth_about_as_often_as_it_says() -> None:
    rng = np.random.default_rng(4)
    found = [estimate(list(rng.normal(0, 1, 30))) for _ in range(200)]
    covered = np.mean([e.low < 0 < e.high for e in found if e.low is not None and e.high is not None])
    assert 0.89 < covered < 0.99


def test_few_values_have_no_interval_and_none_no_mean() -> None:
    """Percentiles of the means of two values are these two: no 95 % of anything."""
    assert [estimate([1.0, 5.0, 3.0][:n]).mean for n in (1, 2, 3)] == [1.0, 3.0, 3.0]
    assert [estimate([1.0, 5.0, 2.0, 3.0, 9.0, 4.0][:n]).low is None for n in range(1, 7)] == [True] * 5 + [False]
    assert estimate([]).mean is None
    assert json.loads(json.dumps(asdict(estimate([])), allow_nan=False))["p"] is None  # summary.json has it


def test_rounding_breaks_no_tie() -> None:
    shares = [1 - n / 24 for n in range(25)]
    pairs = [(3, 5), (7, 9), (1, 3), (11, 12), (9, 7), (13, 15), (20, 22)]  # by 2, 2, 2, 1, -2, 2 and 2 of 24 frames
    assert wilcoxon_p([shares[b] - shares[a] for a, b in pairs]) == wilcoxon_p([float(b - a) for a, b in pairs])


def test_a_difference_is_certain_of_six_that_have_a_sign() -> None:
    assert estimate([0.1] * 6).certain
    assert not estimate([0.1] * 5).certain
    few, enough = (estimate([*[-1.0] * n, *[0.0] * (22 - n)]) for n in (5, 6))
    assert few.high is not None
    assert few.high < 0  # whatever does not differ says nothing of a sign
    assert (few.count, few.certain) == (22, False)
    assert (enough.count, enough.certain) == (22, True)
