import threading

import cv2
import numpy as np
import pytest
import torch

from cltransfer.extractors._dense_flow import with_flow
from cltransfer.extractors.flow_dis import FlowDis
from cltransfer.features import Features


def texture(seed=0, size=(160, 120), shift=(0.0, 0.0)):
    """Smooth coloured noise, moved right and down by ``shift`` [px], (1, 3, H, W)."""
    rng = np.random.default_rng(seed)
    noise = cv2.GaussianBlur(rng.random((size[1] + 80, size[0] + 80, 3)).astype(np.float32), (0, 0), 2)
    noise = (noise - noise.min()) / (noise.max() - noise.min())
    moved = cv2.warpAffine(noise, np.float32([[1, 0, shift[0]], [0, 1, shift[1]]]), noise.shape[1::-1])
    return torch.from_numpy(moved[40:-40, 40:-40]).permute(2, 0, 1)[None]


def features(image, size=None):
    return Features(size or (image.shape[3], image.shape[2]), image=image)


def inner(flow):
    """Median flow (B, 2) away from the borders."""
    return flow[:, :, 25:-25, 25:-25].flatten(2).median(2).values


@pytest.mark.parametrize(("preset", "height"), [("ultrafast", 360), ("medium", 360), ("medium", 60)])
def test_flow_points_back_to_where_things_were(preset, height):
    now, before = texture(shift=(4.0, -3.0)), texture()
    flow = FlowDis(preset=preset, height=height)(features(now), features(before)).flow
    assert flow.shape == (1, 2, 120, 160)
    torch.testing.assert_close(inner(flow), torch.tensor([[-4.0, 3.0]]), atol=0.3, rtol=0)


@pytest.mark.parametrize("preset", ["ultrafast", "fast", "medium"])
@pytest.mark.parametrize("size", [(960, 10), (2000, 24), (24, 2000), (960, 30), (24, 24)])
def test_long_thin_frames_are_read_by_every_preset(preset, size):
    now, before = texture(size=size, shift=(1.0, 0.0)), texture(size=size)
    flow = FlowDis(preset=preset)(features(now), features(before)).flow[0, 0]
    assert float(flow.median()) == pytest.approx(-1.0, abs=0.3)


def test_vectors_are_in_pixels_of_the_features_size():
    now, before = texture(shift=(4.0, -3.0)), texture()
    flow = FlowDis()(features(now, (320, 360)), features(before, (320, 360))).flow
    torch.testing.assert_close(inner(flow), torch.tensor([[-8.0, 9.0]]), atol=0.6, rtol=0)


def test_where_the_frame_before_has_nothing_to_show_flow_is_not_trusted():
    now, before = texture(shift=(6.0, 0.0)), texture()
    got = FlowDis()(features(now), features(before))
    assert got.flow_confidence.shape == (1, 120, 160)
    assert (got.flow_confidence[:, :, :4] < 0.1).float().mean() > 0.95  # came into the frame from the left
    assert (got.flow_confidence[:, 10:-10, 30:-10] > 0.9).float().mean() > 0.95


def test_unchecked_flow_is_the_same_without_a_confidence():
    now, before = features(texture(shift=(4.0, -3.0))), features(texture())
    plain = FlowDis(check=False)
    got = plain(now, before)
    assert plain.provides == ("flow",)
    assert got.flow_confidence is None
    assert torch.equal(got.flow, FlowDis()(now, before).flow)


def test_one_frame_before_serves_a_batch_and_batch_equals_single():
    now, before = torch.cat([texture(shift=(2.0, 0)), texture(shift=(0, 5.0))]), texture()
    flow = FlowDis()(features(now), features(before)).flow
    torch.testing.assert_close(inner(flow), torch.tensor([[-2.0, 0], [0, -5.0]]), atol=0.3, rtol=0)
    alone = FlowDis()(features(now[1:]), features(before)).flow
    assert torch.equal(flow[1:], alone)


@pytest.mark.parametrize(("height", "seen"), [(360, (120, 160)), (60, (60, 80))])
def test_frames_are_looked_at_at_the_working_height_and_never_grown(height, seen):
    shapes = []

    def pair_flow(first, second):
        shapes.append((first.shape, second.shape))
        return np.zeros((*first.shape, 2), np.float32)

    with_flow(features(texture()), features(texture()), pair_flow, height, False)
    assert shapes == [(seen, seen)]


def test_pairs_are_looked_at_side_by_side_and_keep_their_order(monkeypatch):
    monkeypatch.setattr("cltransfer.extractors._dense_flow.thread_count", lambda: 2)
    both = threading.Barrier(2, timeout=20)

    def pair_flow(first, second):
        both.wait()  # for the other pair
        return np.full((*first.shape, 2), first.mean(), np.float32)

    now = torch.cat([texture() * share for share in (1.0, 0.75, 0.5, 0.25)])
    flow = with_flow(features(now), features(texture()), pair_flow, 120, False).flow
    assert flow[:, 0, 0, 0].diff().lt(0).all()


def test_flow_is_looked_for_in_inference_mode_as_elsewhere():
    now, before = torch.cat([texture(shift=(2.0, 0)), texture(shift=(0, 5.0))]), texture()
    wanted = FlowDis()(features(now), features(before))
    with torch.inference_mode():
        got = FlowDis()(features(now), features(before))
    assert torch.equal(got.flow, wanted.flow)
    assert torch.equal(got.flow_confidence, wanted.flow_confidence)


def test_of_no_frames_there_is_no_flow():
    nothing = features(texture()[:0])
    got = FlowDis()(nothing, nothing)
    assert got.flow.shape == (0, 2, 120, 160)
    assert got.flow_confidence.shape == (0, 120, 160)


def test_a_frame_without_one_before_is_nan():
    got = FlowDis()(features(texture()), None)
    assert got.flow.shape == (1, 2, 120, 160)
    assert got.flow.isnan().all()
    assert got.flow_confidence.isnan().all()


def test_a_height_without_room_is_refused():
    with pytest.raises(ValueError, match="height"):
        FlowDis(height=8)
