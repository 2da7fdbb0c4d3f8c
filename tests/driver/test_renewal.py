"""A new Jacobian where a frame ends far worse than usual, ever less often where it does not help."""

from cltransfer.driver.renewal import Renewal


def measured(totals: list[tuple[float, float]], usual: float) -> list[int]:
    """Frames at which one is measured; each ends at the first of its ``totals``, or at the second with a new one."""
    renewal, frames = Renewal(), []
    for i, (before, after) in enumerate(totals):
        renewal = renewal.next()
        if renewal.due(before, usual):
            frames.append(i)
            renewal = renewal.done(before, after)
    return frames


def test_none_where_frames_end_as_usual_or_at_next_to_nothing() -> None:
    assert measured([(0.7, 0.1)] * 5, 0.5) == []
    assert measured([(0.09, 0.0)] * 5, 0.01) == []


def test_at_every_frame_as_long_as_it_helps() -> None:
    assert measured([(2.0, 0.9)] * 5, 0.5) == [0, 1, 2, 3, 4]


def test_half_as_often_each_time_it_does_not() -> None:
    assert measured([(2.0, 1.9)] * 16, 0.5) == [0, 2, 6, 14]


def test_as_often_as_ever_once_it_helped() -> None:
    frames = measured([(2.0, 1.9)] * 6 + [(2.0, 0.5)] * 3, 0.5)
    assert frames == [0, 2, 6, 7, 8]


def test_not_again_at_once_where_new_terms_had_it_measured() -> None:
    assert Renewal(carried=5, wait=2).measured() == Renewal(carried=0, wait=2)
