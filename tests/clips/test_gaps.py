"""Boxes of a person in frames in which the detector lost them."""

import numpy as np
import pytest

from cltransfer.clips.gaps import filled

NAN = float("nan")


def boxes(*left: float) -> np.ndarray:
    """Boxes by their left edge, all else of them following it; NaN where nobody was seen."""
    return np.array([[x, 2 * x, 10 + x, 20.0 + x - x, 0.5 + x - x] for x in left])


def edges(found: np.ndarray) -> list[float | None]:
    return [None if np.isnan(x) else round(float(x), 6) for x in found[:, 0]]


def test_between_two_sights_the_box_goes_straight() -> None:
    found = filled(boxes(NAN, 4, NAN, NAN, 10, 11), np.array([0.0, 0.1, 0.2, 0.4, 0.7, 0.8]))
    assert edges(found) == [4, 4, 5, 7, 10, 11]
    assert found[2].tolist() == pytest.approx([5, 10, 15, 20, 0.5])


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
