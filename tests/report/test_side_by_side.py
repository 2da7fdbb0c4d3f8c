import pytest
import torch

from cltransfer.clips.clip import write_video
from cltransfer.clips.decoding import PIXEL_LIMIT
from cltransfer.report.side_by_side import reference_side, side_by_side


def test_side_by_side_makes_both_equally_high_and_even():
    reference = torch.full((2, 3, 45, 81), 200, dtype=torch.uint8)
    render = torch.full((2, 3, 90, 160), 90, dtype=torch.uint8)
    both = side_by_side(reference, render, torch.tensor([0.0, 0.5]))
    assert both.dtype == torch.uint8
    assert both.shape[2] % 2 == 0
    assert both.shape[3] % 2 == 0
    assert (both[:, :, -60:, 20:140] == 200).all()
    assert (both[:, :, -60:, 180:310] == 90).all()


def test_side_by_side_writes_the_time_of_each_frame():
    frames = torch.zeros((2, 3, 90, 160), dtype=torch.uint8)
    first, second = side_by_side(frames, frames, torch.tensor([0.0, 0.5]))
    changed = (first != second).any(0)
    assert changed[:18, 260:].any()
    assert not changed[:, :200].any()
    assert not changed[18:].any()


def test_side_by_side_refuses_clips_of_different_lengths():
    with pytest.raises(ValueError, match="equally many, got 2, 1, 2"):
        side_by_side(torch.zeros(2, 3, 4, 4).byte(), torch.zeros(1, 3, 4, 4).byte(), torch.zeros(2))


@pytest.mark.parametrize("size", [(2880, 1620), (2040, 2040), (4096, 2026), (2160, 3840)])
def test_large_frames_are_made_smaller_until_both_are_a_clip_that_can_be_read(size):
    width, height = size
    frames = torch.full((1, 3, height, width), 200, dtype=torch.uint8)
    both = side_by_side(frames, frames, torch.zeros(1))
    assert 0.99 * PIXEL_LIMIT < both.shape[2] * both.shape[3] <= PIXEL_LIMIT
    reference = reference_side(both)
    assert reference.shape[3] / reference.shape[2] == pytest.approx(width / height, abs=2e-3)
    assert (reference[..., 4:-4, 4:-4] == 200).all()


def test_frames_of_output_side_2880_are_written_beside_each_other(tmp_path):
    frames, times = torch.zeros((1, 3, 1620, 2880), dtype=torch.uint8), torch.zeros(1)
    write_video(tmp_path / "both.mp4", side_by_side(frames, frames, times), times)
    assert (tmp_path / "both.mp4").is_file()


def test_the_reference_is_cut_out_again_to_a_pixel():
    reference = torch.randint(0, 255, (2, 3, 90, 160), dtype=torch.uint8, generator=torch.Generator().manual_seed(0))
    both = side_by_side(reference, 255 - reference, torch.tensor([0.0, 0.5]))
    assert torch.equal(reference_side(both), reference)
