"""What is tried where a frame ends far worse than usual, ever less often where it does not help."""

from dataclasses import replace

from cltransfer.driver.retry import RENEWAL, RESCUE, Retry


def tried(retry: Retry, totals: list[tuple[float, float]], usual: float, limit: float) -> list[int]:
    """Frames for which it is tried; each ends at the first of its ``totals``, or at the second thereby."""
    frames = []
    for i, (before, after) in enumerate(totals):
        retry = retry.next()
        if retry.due(before, usual, limit):
            frames.append(i)
            retry = retry.done(before, after)
    return frames


def test_a_jacobian_for_none_that_ends_as_usual_or_at_next_to_nothing() -> None:
    assert tried(RENEWAL, [(0.7, 0.1)] * 5, 0.5, 0.1) == []
    assert tried(RENEWAL, [(0.09, 0.0)] * 5, 0.01, 0.1) == []


def test_a_jacobian_for_every_frame_as_long_as_it_helps() -> None:
    assert tried(RENEWAL, [(2.0, 0.9)] * 5, 0.5, 0.1) == [0, 1, 2, 3, 4]


def test_a_jacobian_half_as_often_each_time_it_does_not() -> None:
    assert tried(RENEWAL, [(2.0, 1.1)] * 16, 0.5, 0.1) == [0, 2, 6, 14]


def test_a_jacobian_as_often_as_ever_once_it_helped() -> None:
    assert tried(RENEWAL, [(2.0, 1.9)] * 6 + [(2.0, 0.5)] * 3, 0.5, 0.1) == [0, 2, 6, 7, 8]


def test_a_search_for_none_that_is_good_enough_or_as_poor_as_others() -> None:
    assert tried(RESCUE, [(1.9, 0.1)] * 5, 0.1, 2.0) == []
    assert tried(RESCUE, [(3.9, 0.1)] * 5, 1.0, 2.0) == []


def test_a_search_for_every_frame_as_long_as_it_helps() -> None:
    assert tried(RESCUE, [(4.1, 2.8)] * 5, 1.0, 2.0) == [0, 1, 2, 3, 4]


def test_a_search_four_times_as_seldom_each_time_it_does_not() -> None:
    assert tried(RESCUE, [(4.1, 2.9)] * 24, 1.0, 2.0) == [0, 4, 20]


def test_a_search_as_often_as_ever_once_it_helped() -> None:
    assert tried(RESCUE, [(4.1, 2.9)] * 4 + [(4.1, 2.8)] * 3, 1.0, 2.0) == [0, 4, 5, 6]


def test_none_at_once_after_a_frame_for_which_it_was_done_anyway() -> None:
    assert replace(RENEWAL, since=5, wait=2).needless() == replace(RENEWAL, since=0, wait=2)
