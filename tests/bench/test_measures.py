"""Numbers of a row, where another reading of the row would be another number."""

import pytest

from cltransfer.bench.measures import SIDE_MEASURES


def _value(name, row):
    return SIDE_MEASURES[name][1](row)


def test_shot_scale_is_told_by_the_share_of_frames_that_differ():
    assert _value("other shot scale", {"scale_agreement": 0.25}) == 0.75


def test_jerk_is_told_by_how_far_it_is_from_the_reference_s_either_way():
    for jerk, reference in ((0.1, 0.4), (0.4, 0.1)):
        row = {"jerk": jerk, "reference_jerk": reference}
        assert _value("jerk apart from the reference's", row) == pytest.approx(0.3)


def test_a_term_as_printed_is_the_mean_of_the_frames_where_both_sides_have_it_and_no_penalty():
    row = {"priced": {"framing": [5.0, 7.0, 9.0]}, "faithful": {"framing": [None, 0.25, 0.75]}}
    assert _value("framing, as printed", row) == 0.5
