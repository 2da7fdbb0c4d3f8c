import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from cltransfer.errors import ModelError
from cltransfer.extractors.orient_anything import MARGIN, OrientAnything, mask_boxes, read_bins
from cltransfer.features import Features
from cltransfer.testing import ExtractorCase

STD = np.array([0.229, 0.224, 0.225])
SIZE = (200, 160)


def row(azimuth, elevation, rotation, width=902):
    """Logits that answer these angles [degrees], sure or not left open."""
    logits = np.zeros(width, np.float32)
    turns = width - 542
    logits[[azimuth, 360 + 90 + elevation, 540 + turns // 2 + rotation]] = 9
    return logits


@pytest.fixture
def planted(network, node):
    """Orient Anything whose answer to red, green and blue is a row each, and as sure as the crop is bright.

    ``rows`` are logits for 1 of each channel's mean over the crop.
    """

    def build(rows, batch="batch", unsure=10, **options):
        rows = np.stack(rows)
        rows[:, -2] = 20
        mean = np.array([0.485, 0.456, 0.406])
        constants = {
            "std": STD.reshape(1, 3, 1, 1).astype(np.float32),
            "mean": mean.reshape(1, 3, 1, 1).astype(np.float32),
            "axes": np.array([2, 3]),
            "rows": rows.astype(np.float32),
            "unsure": np.eye(rows.shape[1], dtype=np.float32)[-1] * unsure,
        }
        nodes = [
            node("Mul", "pixel_values std", "scaled"),
            node("Add", "scaled mean", "rgb"),
            node("ReduceMean", "rgb axes", "colour", keepdims=0),
            node("MatMul", "colour rows", "bins"),
            node("Add", "bins unsure", "logits"),
        ]
        shapes = {"pixel_values": [batch, 3, 224, 224]}, {"logits": [batch, rows.shape[1]]}
        return OrientAnything(network(nodes, *shapes, constants), **options)

    return build


def degrees(*angles):
    return torch.tensor([math.radians(a) for a in angles])


RED, GREEN, BLUE = row(30, 10, -20), row(270, -40, 5), row(180, 0, 0)


def frames(*colours, background=(0.0, 0.0, 1.0)):
    """Squares of 80 px of each colour before a background, with their masks."""
    image = torch.tensor(background)[:, None, None].expand(3, SIZE[1], SIZE[0]).repeat(len(colours), 1, 1, 1)
    subject = torch.zeros(len(colours), SIZE[1], SIZE[0], dtype=torch.bool)
    subject[:, 40:120, 70:150] = True
    for frame, colour in zip(image, colours):
        frame[:, 40:120, 70:150] = torch.tensor(colour)[:, None, None]
    return Features(SIZE, image=image, subject=subject)


@pytest.mark.parametrize("batch", ["batch", 1])
def test_each_subject_gets_its_own_angles_in_our_convention(planted, batch):
    angles = planted([RED, GREEN, BLUE], batch)(frames((1.0, 0, 0), (0, 1.0, 0))).orientation
    # seen from the body's left and from above, leaning right; then from its right and from below, leaning left
    torch.testing.assert_close(angles, torch.stack([degrees(30, 10, 20), degrees(-90, -40, -5)]))


def test_the_background_is_removed_unless_it_is_asked_for(planted):
    blue = row(180, 0, 0) * 40
    cut = planted([RED, GREEN, blue])(frames((1.0, 0, 0))).orientation
    torch.testing.assert_close(cut[0], degrees(30, 10, 20))
    whole = planted([RED, GREEN, blue], remove_background=False)(frames((1.0, 0, 0))).orientation
    torch.testing.assert_close(whole[0], degrees(180, 0, 0))


def test_the_subject_fills_the_published_part_of_the_crop(planted):
    """The logit for sure is 20 x the mean of the crop, which is red as far as the subject fills it."""
    filled = 1 / MARGIN**2
    sure = 1 / (1 + math.exp(19 - 20 * filled))
    features = frames((1.0, 0, 0))
    assert planted([RED] * 3, unsure=19, min_confidence=sure - 0.02)(features).orientation.isfinite().all()
    assert planted([RED] * 3, unsure=19, min_confidence=sure + 0.02)(features).orientation.isnan().all()


def test_bins_are_read_with_half_and_with_whole_turns():
    for width in (722, 902):
        logits = torch.from_numpy(np.stack([row(0, 0, 0, width), row(359, 89, 80, width), row(181, -90, -90, width)]))
        angles, confidence = read_bins(logits)
        expected = torch.stack([degrees(0, 0, 0), degrees(-1, 89, -80), degrees(-179, -90, 90)])
        torch.testing.assert_close(angles, expected)
        torch.testing.assert_close(confidence, torch.full((3,), 0.5))
    upside_down, _ = read_bins(torch.from_numpy(row(180, 0, -180))[None])
    torch.testing.assert_close(upside_down[0], degrees(180, 0, 180))


def test_a_frame_without_a_subject_is_nan(planted):
    features = frames((1.0, 0, 0), (0, 1.0, 0))
    features.subject[0] = False
    angles = planted([RED, GREEN, BLUE])(features).orientation
    assert angles[0].isnan().all()
    torch.testing.assert_close(angles[1], degrees(-90, -40, -5))


@pytest.mark.parametrize("remove_background", [True, False])
@pytest.mark.parametrize("step", [2, 5])
def test_a_mask_of_fewer_pixels_cuts_the_same_crop(planted, step, remove_background):
    seen = []

    def look(given):
        seen.append(given["pixel_values"])
        return {"logits": RED[None]}

    extractor = planted([RED, GREEN, BLUE], remove_background=remove_background)
    extractor.__dict__["network"] = look
    whole = frames((1.0, 0, 0))
    extractor(whole)
    extractor(replace(whole, subject=whole.subject[:, step // 2 :: step, step // 2 :: step]))
    np.testing.assert_array_equal(*seen)


def test_a_large_subject_of_fine_stripes_is_seen_as_their_mean(planted):
    """Its crop has 3.2 pixels of the frame to one."""
    seen = []

    def look(given):
        seen.append(given["pixel_values"])
        return {"logits": RED[None]}

    extractor = planted([RED, GREEN, BLUE])
    extractor.__dict__["network"] = look
    image = torch.zeros(1, 3, 700, 700)
    image[:, :, ::2] = 1.0
    extractor(Features((700, 700), image=image, subject=torch.ones(1, 700, 700, dtype=torch.bool)))
    inside = seen[0][0, :, 8:-8, 8:-8] * STD.reshape(3, 1, 1)
    assert np.ptp(inside, axis=(1, 2)).max() < 0.5  # 1 where rows are left out


def test_boxes_hold_exactly_the_mask():
    masks = np.zeros((2, 20, 30), bool)
    masks[0, 3:9, 10:12] = True
    boxes = mask_boxes(masks)
    assert boxes[0].tolist() == [10, 3, 2, 6]
    assert np.isnan(boxes[1]).all()


def test_options_and_other_numbers_of_bins_are_refused(planted):
    with pytest.raises(ValueError, match="min_confidence"):
        OrientAnything("a.onnx", min_confidence=2)
    odd = planted([np.zeros(900, np.float32)] * 3)
    with pytest.raises(ModelError, match="722 or 902"):
        odd(frames((1.0, 0, 0)))


class TestContract(ExtractorCase):
    @pytest.fixture(autouse=True)
    def use(self, planted):
        self.component = planted([RED, GREEN, BLUE], min_confidence=0)
