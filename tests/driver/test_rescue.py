"""CMA-ES for a frame far above the others, ever less often where it does not help."""

from cltransfer.driver.rescue import Rescue


def searched(totals: list[tuple[float, float]], usual: float, limit: float = 2.0) -> list[int]:
    """Frames that are searched so; each ends at the first of its ``totals``, or at the second thereby."""
    rescue, frames = Rescue(), []
    for i, (before, after) in enumerate(totals):
        rescue = rescue.next()
        if rescue.due(before, usual, limit):
            frames.append(i)
            rescue = rescue.done(before, after)
    return frames


def test_none_that_is_good_enough_or_as_poor_as_others() -> None:
    assert searched([(1.9, 0.1)] * 5, 0.1) == []
    assert searched([(3.9, 0.1)] * 5, 1.0) == []


def test_every_one_as_long_as_it_helps() -> None:
    assert searched([(4.1, 2.8)] * 5, 1.0) == [0, 1, 2, 3, 4]


def test_four_times_as_seldom_each_time_it_does_not() -> None:
    assert searched([(4.1, 2.9)] * 24, 1.0) == [0, 4, 20]


def test_as_often_as_ever_once_it_helped() -> None:
    assert searched([(4.1, 2.9)] * 4 + [(4.1, 2.8)] * 3, 1.0) == [0, 4, 5, 6]
