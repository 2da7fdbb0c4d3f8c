import cv2
import numpy as np
import pytest
import torch

from cltransfer.extractors.flow_deep import FlowDeep
from cltransfer.features import Features


def wavy(shift=(0.0, 0.0), size=(96, 64)):
    """Smooth coloured noise, moved right and down by ``shift`` [px]."""
    noise = np.random.default_rng(4).random((size[1] + 40, size[0] + 40, 3)).astype(np.float32)
    noise = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 4), None, 0, 1, cv2.NORM_MINMAX)
    moved = cv2.warpAffine(noise, np.float32([[1, 0, shift[0]], [0, 1, shift[1]]]), noise.shape[1::-1])
    return Features(size, image=torch.from_numpy(moved[20:-20, 20:-20]).permute(2, 0, 1)[None])


def test_flow_points_back_to_where_things_were_and_is_trusted_there():
    got = FlowDeep()(wavy((5.0, -2.0)), wavy())
    middle = got.flow[0, :, 16:-16, 16:-16].flatten(1).median(1).values
    torch.testing.assert_close(middle, torch.tensor([-5.0, 2.0]), atol=0.1, rtol=0)
    assert (got.flow_confidence[0, 10:-10, 12:-12] > 0.9).all()
    assert (got.flow_confidence[0, :, :3] < 0.1).all()


def test_working_height_changes_the_grid_and_not_the_unit():
    size = (160, 128)
    low = FlowDeep(height=80, check=False)(wavy((5.0, -2.0), size), wavy(size=size))
    assert low.flow_confidence is None
    middle = low.flow[0, :, 16:-16, 16:-16].flatten(1).median(1).values
    torch.testing.assert_close(middle, torch.tensor([-5.0, 2.0]), atol=0.3, rtol=0)


def test_a_frame_without_one_before_is_nan_and_a_height_without_room_refused():
    got = FlowDeep()(wavy(), None)
    assert got.flow.isnan().all()
    assert got.flow_confidence.isnan().all()
    with pytest.raises(ValueError, match="height must be at least 24, got 8"):
        FlowDeep(height=8)
