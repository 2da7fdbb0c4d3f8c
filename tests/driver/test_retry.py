"""What is tried where a frame ends far worse than usual, ever less often where it does not help."""

from dataclasses import replace

import pytest

from cltransfer.driver.retry import RENEWAL, RESCUE, Retry

GOOD_ENOUGH = {RENEWAL: 0.1, RESCUE: 2.0}
Totals = list[tuple[float, float]]


def tried(retry: Retry, totals: Totals, usual: float) -> list[int]:
    """Frames for which it is tried; each ends at the first of its ``totals``, or at the second thereby."""
    frames, limit = [], GOOD_ENOUGH[retry]
    for i, (before, after) in enumerate(totals):
        retry = retry.next()
        if retry.due(before, usual, limit):
            frames.append(i)
            retry = retry.done(before, after)
    return frames


@pytest.mark.parametrize(
    ("retry", "total", "usual"),
    [(RENEWAL, 0.7, 0.5), (RENEWAL, 0.09, 0.01), (RESCUE, 3.9, 1.0), (RESCUE, 1.9, 0.1)],
)
def test_never_for_frames_that_end_about_as_usual_or_good_enough(retry: Retry, total: float, usual: float) -> None:
    assert tried(retry, [(total, 0.0)] * 5, usual) == []


@pytest.mark.parametrize(
    ("retry", "totals", "frames"),
    [
        pytest.param(RENEWAL, [(2.0, 0.9)] * 5, [0, 1, 2, 3, 4], id="a Jacobian every time it helps"),
        pytest.param(RENEWAL, [(2.0, 1.1)] * 16, [0, 2, 6, 14], id="half as often where it does not"),
        pytest.param(RENEWAL, [(2.0, 1.9)] * 6 + [(2.0, 0.5)] * 3, [0, 2, 6, 7, 8], id="as ever once it helped"),
        pytest.param(RESCUE, [(4.1, 2.8)] * 5, [0, 1, 2, 3, 4], id="a search every time it helps"),
        pytest.param(RESCUE, [(4.1, 2.9)] * 24, [0, 4, 20], id="a quarter as often where it does not"),
        pytest.param(RESCUE, [(4.1, 2.9)] * 4 + [(4.1, 2.8)] * 3, [0, 4, 5, 6], id="a search as ever once it helped"),
    ],
)
def test_ever_less_often_where_it_does_not_help(retry: Retry, totals: Totals, frames: list[int]) -> None:
    assert tried(retry, totals, usual=1.0) == frames


def test_none_at_once_after_a_frame_for_which_it_was_done_anyway() -> None:
    assert replace(RENEWAL, since=5, wait=2).needless() == replace(RENEWAL, since=0, wait=2)
