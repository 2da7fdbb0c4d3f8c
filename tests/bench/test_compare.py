"""Paired statistics against their definitions."""

import math

import numpy as np
import pytest

from cltransfer.bench.compare import compared, holm, together
from cltransfer.paired import estimate, wilcoxon_p


def test_holm_by_its_definition():
    assert holm([0.01, 0.02, 0.03, 0.5, 0.04]) == pytest.approx([0.05, 0.08, 0.09, 0.5, 0.09])
    assert holm([0.9, 0.8]) == [1.0, 1.0]


def test_what_was_not_tested_counts_for_nothing():
    corrected = holm([0.02, math.nan, 0.01])
    assert corrected[0] == pytest.approx(0.02)
    assert math.isnan(corrected[1])
    assert corrected[2] == pytest.approx(0.02)


def test_a_difference_is_ours_minus_the_baseline_s_clip_by_clip():
    rng = np.random.default_rng(3)
    ours = rng.uniform(0, 1, 40)
    found = compared("framing", "frame", (ours + 0.2).tolist(), ours.tolist())
    assert found.difference.mean == pytest.approx(-0.2)
    assert found.difference.certain
    assert found.wins == 1.0
    assert found.p < 1e-6


def test_a_clip_without_a_value_is_left_out_of_both_sides():
    found = compared("framing", "frame", [1.0, math.nan, 3.0], [0.5, 9.0, 3.5])
    assert found.difference.count == found.ours.count == found.baseline.count == 2
    assert found.ours.mean == pytest.approx(2.0)


def test_noise_is_rarely_told_to_be_a_difference():
    rng = np.random.default_rng(0)
    certain = 0
    for _ in range(60):
        a, b = rng.normal(0, 1, (2, 30))
        certain += compared("x", "", a.tolist(), b.tolist()).difference.certain
    assert certain <= 7


def test_a_few_skewed_differences_are_rarely_told_to_be_one():
    """By their interval alone 25 of 100 are."""
    rng = np.random.default_rng(0)
    differences = np.exp(rng.normal(0, 1, (100, 6))) - np.exp(0.5)  # of mean 0
    assert sum(estimate(d.tolist()).certain for d in differences) <= 10


def test_nothing_that_differs_is_no_evidence():
    assert wilcoxon_p([0.0, 0.0, 0.0]) == 1.0
    assert wilcoxon_p([-1.0, -2.0, -3.0, -4.0] + [0.0] * 18) == 0.125  # four signs of four, whatever did not differ
    assert wilcoxon_p([]) is None
    same = together([compared("x", "", [1.0, 2.0], [1.0, 2.0])])
    assert same[0].p_holm == 1.0


def test_a_clip_that_is_the_same_is_no_win():
    found = compared("x", "", [1.0, 2.0, 3.0, 4.0], [0.5, 2.0, 3.5, 4.0])
    assert found.wins == 0.25
