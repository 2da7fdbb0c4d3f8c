"""Confidence of a flow: there and back again."""

import pytest
import torch

from cltransfer.extractors._flow_check import round_trip_confidence


def constant(x, y, size=(16, 12)):
    return torch.tensor([x, y])[None, :, None, None].expand(1, 2, size[1], size[0]).clone()


def test_flows_that_undo_one_another_are_trusted():
    confidence = round_trip_confidence(constant(2.0, -1.0), constant(-2.0, 1.0))
    torch.testing.assert_close(confidence[:, 1:, :-2], torch.ones(1, 11, 14))


def test_what_leads_out_of_the_frame_is_not_trusted():
    confidence = round_trip_confidence(constant(2.6, 0.0), constant(-2.6, 0.0))
    assert not confidence[:, :, -2:].any()  # centres 1.5 and 0.5 px from the right edge
    assert (confidence[:, :, :-3] == 1).all()


@pytest.mark.parametrize(("length", "miss"), [(0.0, 0.5**0.5), (4.0, (0.32 + 0.5) ** 0.5)])
def test_confidence_is_a_half_at_the_published_threshold(length, miss):
    backward, forward = constant(0.0, length, (16, 40)), constant(miss, -length, (16, 40))
    got = round_trip_confidence(backward, forward)[0, 10, 8]
    assert float(got) == pytest.approx(0.5, abs=0.01)  # the miss itself adds 1 % to what is allowed


def test_the_forward_flow_is_read_where_the_backward_flow_leads():
    backward, forward = constant(3.0, 0.0), constant(0.0, 0.0)
    forward[:, 0, :, 8:] = -3.0  # only the right half of the frame before moved
    confidence = round_trip_confidence(backward, forward)
    assert (confidence[:, :, 5:13] == 1).all()
    assert (confidence[:, :, :4] < 0.01).all()


def test_undefined_flow_is_undefined_confidence():
    backward, forward = constant(1.0, 0.0), constant(-1.0, 0.0)
    backward[0, :, 3, 4] = torch.nan
    confidence = round_trip_confidence(backward, forward)
    assert confidence[0, 3, 4].isnan()
    assert int(confidence.isnan().sum()) == 1


def test_flows_on_two_grids_are_refused():
    with pytest.raises(ValueError, match=r"flows must share a grid, got \(1, 2, 12, 16\) and \(1, 2, 6, 8\)"):
        round_trip_confidence(constant(0.0, 0.0), constant(0.0, 0.0, (8, 6)))
