from pathlib import Path

import numpy as np
import pytest
import torch

from cltransfer.clips.clip import read_clip
from cltransfer.extractors.detect_yolox import DetectYolox
from cltransfer.extractors.pose_blazepose import PoseBlazepose
from cltransfer.extractors.segment_selfie import SegmentSelfie
from cltransfer.features import Features
from cltransfer.testing import ExtractorCase

DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data"


@pytest.fixture
def planted(network, node):
    """A network whose probability is how red a pixel is."""
    constants = {"red": np.float32([1, -0.5, -0.5]).reshape(1, 3, 1, 1)}
    nodes = [node("Conv", "input red", "signed"), node("Relu", "signed", "output")]
    model = network(nodes, {"input": [1, 3, 144, 256]}, {"output": [1, 1, 144, 256]}, constants)
    return lambda **options: SegmentSelfie(model, **options)


def patch(size=(120, 300), redness=1.0):
    image = torch.full((2, 3, size[1], size[0]), 0.4)
    image[0, :, 30:90, 40:100] = torch.tensor([redness, 0, 0])[:, None, None]
    image[1, :, 200:260, 10:50] = torch.tensor([0, 0, redness])[:, None, None]
    return image


def test_the_mask_covers_what_is_red_on_the_pixels_of_the_image(planted):
    image = patch()
    got = planted()(Features((240, 600), image=image)).subject
    red = image[:, 1] == 0
    assert got.shape == (2, 300, 120)
    assert (got[0] & red[0]).sum() > 0.95 * (got[0] | red[0]).sum()
    assert not got[1].any()  # blue


def test_a_narrow_frame_of_stripes_is_seen_as_their_mean(planted):
    """The network sees 144 rows of 300, and 256 columns for 120."""
    image = torch.zeros(1, 3, 300, 120)
    image[:, 0, ::2] = 1.0
    features = Features((120, 300), image=image)
    assert planted(threshold=0.3)(features).subject.all()
    assert not planted(threshold=0.7)(features).subject.any()


def test_the_threshold_is_a_probability(planted):
    features = Features((120, 300), image=patch(redness=0.6))
    assert planted(threshold=0.5)(features).subject.any()
    assert not planted(threshold=0.7)(features).subject.any()
    with pytest.raises(ValueError, match="threshold"):
        planted(threshold=1.0)


class TestContract(ExtractorCase):
    @pytest.fixture(autouse=True)
    def use(self, planted):
        self.component = planted()


@pytest.mark.needs(
    "models/yolox_nano.onnx",
    "models/mp_pose_landmark_lite.onnx",
    "models/mp_selfie_segmentation_landscape.onnx",
    "video/lp_s32.mp4",
)
def test_real_weights_agree_with_blazepose_on_a_medium_shot(monkeypatch):
    monkeypatch.setenv("CLTRANSFER_MODELS", str(DATA / "models"))
    clip = read_clip(DATA / "video" / "lp_s32.mp4", frames=3, max_side=640).features()
    ours = SegmentSelfie()(clip).subject
    other = PoseBlazepose()(DetectYolox()(clip)).subject
    overlap = (ours & other).flatten(1).sum(1) / (ours | other).flatten(1).sum(1)
    assert (overlap > 0.8).all(), overlap
