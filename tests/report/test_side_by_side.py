import pytest
import torch

from cltransfer.report.side_by_side import side_by_side


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
