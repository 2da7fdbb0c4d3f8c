"""Frames of two clips go together by their times."""

from pathlib import Path

import pytest
import torch

from cltransfer.clips.clip import write_video
from cltransfer.clips.pairs import open_pairs, pair_by_time, pairs
from cltransfer.clips.source import ClipSource
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


@pytest.mark.parametrize(
    ("shown", "kept"),
    [([-0.4, 0.3], [0, 1]), ([-0.5, 0.3], [1]), ([0.3, 2.4], [0, 1]), ([0.3, 2.5], [0])],
)
def test_a_frame_a_whole_step_before_the_reference_or_behind_it_has_no_partner(
    shown: list[float], kept: list[int]
) -> None:
    """Of the first step before it, and of the last behind it."""
    assert pairs(torch.tensor([0.0, 0.5, 1.5]), torch.tensor(shown))[1].tolist() == kept


def test_frames_before_and_behind_the_reference_alone_are_none_of_it() -> None:
    with pytest.raises(InputError, match="all frames of one lie before or after the other"):
        pairs(torch.tensor([0.0, 0.5]), torch.tensor([-0.6, 1.1]))


@pytest.mark.parametrize(("long", "ends"), [(12, False), (13, False), (20, True)])
def test_a_render_of_half_the_frames_ends_early_if_more_than_a_frame_of_its_own_is_missing(
    tmp_path: Path, long: int, ends: bool
) -> None:
    clips = []
    for name, frames, rate in (("reference", long, 10), ("render", 6, 5)):
        black = torch.zeros(frames, 3, 16, 16, dtype=torch.uint8)
        write_video(tmp_path / f"{name}.mkv", black, torch.arange(frames).double() / rate, lossless=True)
        clips.append(ClipSource(tmp_path / f"{name}.mkv"))
    notes = open_pairs(clips[0], clips[1], None)[2]
    told = f"ends at 1.00 s, the reference at {(long - 1) / 10:.2f} s: what comes after is not scored"
    assert (told in notes) == ends
    assert any(f"6 of {long} frames of the reference are paired" in note for note in notes)
