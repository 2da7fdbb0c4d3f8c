"""Frames of two clips go together by their times."""

import pytest
import torch

from cltransfer.clips.pairs import pair_by_time, pairs
from cltransfer.errors import InputError


def test_pair_by_time_finds_the_nearest_frame():
    index = pair_by_time(torch.arange(5) / 10, torch.arange(9) / 20)
    assert index[::2].tolist() == [0, 1, 2, 3, 4]
    with pytest.raises(InputError, match="no moment"):
        pair_by_time(torch.tensor([0.0, 1.0]), torch.tensor([2.0, 3.0]))


@pytest.mark.parametrize("kind", [torch.float32, torch.float64])
@pytest.mark.parametrize("steps", [8, 1_000_000])  # in so many places a second: in few, many are as near on either side
@pytest.mark.parametrize(("count", "other"), [(1, 5), (2, 1), (7, 30), (300, 200)])
def test_pairs_are_those_of_the_distances_between_all(kind, steps, count, other):
    g = torch.Generator().manual_seed(count)
    times, shown = ((torch.randint(0, 9 * steps, (n,), generator=g).unique() / steps).to(kind) for n in (count, other))
    shown[0], shown[-1] = min(shown[0], times[-1]), max(shown[-1], times[0])  # they share a moment
    assert torch.equal(pair_by_time(times, shown), (times[None, :] - shown[:, None]).abs().argmin(1))


def test_clips_of_hours_are_paired_without_the_distances_between_all():
    times = torch.arange(200_000).double() / 24
    assert torch.equal(pair_by_time(times, times + 0.01), torch.arange(200_000))


def test_of_several_frames_of_a_render_the_nearest_is_kept() -> None:
    assert pairs(torch.tensor([0.0, 0.5, 1.0]), torch.tensor([0.3, 0.5, 0.7, 1.0]))[1].tolist() == [1, 3]
