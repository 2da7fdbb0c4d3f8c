"""Sparse points spread to maps."""

from __future__ import annotations

import torch

from cltransfer.sfm.depth import spread_depth
from cltransfer.sfm.points import Points


def points(pixels, depth, confidence, frames=None):
    count = len(depth)
    frames = torch.zeros(count, dtype=torch.long) if frames is None else torch.tensor(frames)
    return Points(
        frames, torch.tensor(pixels), torch.tensor(depth), torch.tensor(confidence), torch.zeros(count).bool()
    )


def test_a_pixel_takes_the_nearest_point_on_its_side_of_the_outline():
    subject = torch.zeros(1, 10, 20, dtype=torch.bool)
    subject[:, :, 10:] = True
    sparse = points([[2.5, 5.5], [7.5, 5.5], [12.5, 5.5]], [4.0, 6.0, 2.0], [0.9, 0.8, 0.7])
    depth, confidence = spread_depth(sparse, subject, 1.0, 0.5)
    assert (depth[0, :, :5] == 4).all()
    assert (depth[0, :, 6:10] == 6).all()
    assert (depth[0, :, 10:] == 2).all()  # though the point at 7.5 is nearer to some
    torch.testing.assert_close(confidence[0, 0, [0, 9, 19]], torch.tensor([0.9, 0.8, 0.7]))


def test_out_of_reach_and_without_a_sure_point_there_is_no_depth():
    subject = torch.zeros(3, 10, 20, dtype=torch.bool)
    sparse = points([[0.5, 5.5], [10.5, 5.5]], [4.0, 3.0], [0.9, 0.2], [0, 1])
    depth, confidence = spread_depth(sparse, subject, 0.25, 0.5)
    assert (depth[0, 5, :6] == 4).all()
    assert depth[0, 5, 6:].isnan().all()
    assert depth[1:].isnan().all()
    assert torch.equal(depth.isnan(), confidence.isnan())
