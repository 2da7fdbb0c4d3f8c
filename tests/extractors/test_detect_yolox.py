from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from onnx import TensorProto, helper, numpy_helper

from cltransfer.clips.clip import read_clip
from cltransfer.errors import ModelError
from cltransfer.extractors.detect_yolox import PERSON, DetectYolox, decode_grid, main_box
from cltransfer.features import Features

DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data"


@pytest.fixture
def planted(tmp_path, monkeypatch):
    """A network of YOLOX's shapes that sees a person, 16 wide and 32 high, in each blue cell of stride 16."""
    first, last = np.zeros((1, 2704, 85), np.float32), np.zeros((1, 169, 85), np.float32)
    cell = np.zeros((1, 676, 4), np.float32)
    cell[..., :2], cell[..., 3] = 0.5, np.log(2)
    classes = np.zeros((1, 676, 80), np.float32)
    classes[..., 0] = 1
    blueness = np.array([1, -0.5, -0.5], np.float32).reshape(1, 3, 1, 1) / 255  # of BGR
    arrays = {"first": first, "last": last, "cell": cell, "classes": classes, "blueness": blueness}
    weights = [numpy_helper.from_array(value, name) for name, value in arrays.items()]
    weights.append(numpy_helper.from_array(np.array([1, 676, 1]), "column"))
    nodes = [
        helper.make_node("Conv", ["images", "blueness"], ["blue"]),
        helper.make_node("AveragePool", ["blue"], ["cells"], kernel_shape=[16, 16], strides=[16, 16]),
        helper.make_node("Reshape", ["cells", "column"], ["object"]),
        helper.make_node("Concat", ["cell", "object", "classes"], ["middle"], axis=2),
        helper.make_node("Concat", ["first", "middle", "last"], ["output"], axis=1),
    ]
    images = helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, 3, 416, 416])
    output = helper.make_tensor_value_info("output", TensorProto.FLOAT, [1, 3549, 85])
    graph = helper.make_graph(nodes, "yolox", [images], [output], weights)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    onnx.save_model(model, str(tmp_path / "planted.onnx"))
    monkeypatch.setenv("CLTRANSFER_MODELS", str(tmp_path))
    return DetectYolox(model="planted.onnx")


def blue_at(cell, size):
    """An image of ``size`` that is blue where the network has its cell (x, y), and the box it should find."""
    in_square = np.floor(np.array(size) * 416 / max(size))  # what the image takes of the square
    scale = in_square / size
    low = np.maximum(0, np.floor(16 * np.array(cell) / scale - 2)).astype(int)
    high = np.ceil(16 * (np.array(cell) + 1) / scale + 2).astype(int)
    image = torch.full((1, 3, size[1], size[0]), 0.3)
    image[:, :, low[1] : high[1], low[0] : high[0]] = torch.tensor([0, 0, 1.0])[:, None, None]
    center, extent = 16 * (np.array(cell) + 0.5) / scale, np.array([16, 32]) / scale
    return image, torch.tensor([*(center - extent / 2), *extent], dtype=torch.float32)


@pytest.mark.parametrize(("size", "cell"), [((480, 908), (5, 20)), ((960, 540), (21, 3)), ((416, 416), (0, 25))])
def test_finds_a_planted_box_wherever_the_letterbox_puts_it(planted, size, cell):
    image, expected = blue_at(cell, size)
    box = planted(Features(size, image=image)).box
    torch.testing.assert_close(box[0, :4], expected, atol=0.01, rtol=0)
    assert box[0, 4] > 0.95


def test_box_is_in_pixels_of_the_features_size(planted):
    image, expected = blue_at((5, 7), (480, 360))
    box = planted(Features((960, 720), image=image)).box
    torch.testing.assert_close(box[0, :4], 2 * expected, atol=0.02, rtol=0)


def test_a_frame_without_a_person_is_nan_and_the_others_are_as_alone(planted):
    image, _ = blue_at((5, 7), (480, 360))
    batch = torch.cat([torch.zeros_like(image), image, torch.ones_like(image)])
    box = planted(Features((480, 360), image=batch)).box
    assert box[[0, 2]].isnan().all()
    assert torch.equal(box[1:2], planted(Features((480, 360), image=image)).box)


@pytest.mark.parametrize("size", [(1000, 2), (2, 1000)])
def test_a_frame_that_is_thinner_than_a_pixel_of_the_network_is_read(planted, size):
    assert planted(Features(size, image=torch.zeros(1, 3, size[1], size[0]))).box.isnan().all()


def test_a_cell_is_a_person_where_that_is_its_best_class():
    dog = 16
    raw = np.zeros((1, 3549, 85), np.float32)
    raw[0, :, 4] = 0.9
    raw[0, :3, 5 + PERSON] = 0.6, 0.6, 0.4
    raw[0, :3, 5 + dog] = 0.8, 0.5, 0.0
    scores = decode_grid(raw)[1]
    np.testing.assert_allclose(scores[0, :4], [0, 0.54, 0.36, 0], rtol=1e-6)
    assert scores.dtype == np.float32


def test_the_main_person_has_the_largest_score_times_area():
    boxes = np.array([[[0, 0, 10, 10.0], [5, 5, 20, 20], [0, 0, 90, 90], [7, 7, 19, 19]]])
    scores = np.array([[0.9, 0.5, 0.2, 0.8]])
    assert main_box(boxes, scores, 0.3)[0].tolist() == [7, 7, 19, 19, 0.8]
    assert np.isnan(main_box(boxes, scores, 0.95)).all()


def test_options_and_missing_models_are_refused(monkeypatch, tmp_path):
    with pytest.raises(ValueError, match="min_score"):
        DetectYolox(min_score=1.5)
    monkeypatch.setenv("CLTRANSFER_MODELS", str(tmp_path))
    with pytest.raises(ModelError, match="no such file"):
        DetectYolox(model="none.onnx")(Features((8, 8), image=torch.zeros(1, 3, 8, 8)))


@pytest.mark.needs("models/yolox_nano.onnx", "video/lp_s20.mp4", "video/intel_one_by_one_person.mp4")
class TestRealWeights:
    def boxes(self, monkeypatch, name, frames):
        monkeypatch.setenv("CLTRANSFER_MODELS", str(DATA / "models"))
        return DetectYolox()(read_clip(DATA / "video" / name, frames=frames).features()).box

    def test_a_person_is_in_every_frame_of_a_pull_back_and_gets_smaller(self, monkeypatch):
        box = self.boxes(monkeypatch, "lp_s20.mp4", 5)
        assert (box[:, 4] > 0.8).all()
        area = box[:, 2] * box[:, 3]
        assert area[-1] < 0.8 * area[0]

    def test_empty_frames_have_no_box(self, monkeypatch):
        box = self.boxes(monkeypatch, "intel_one_by_one_person.mp4", 12)
        empty = box.isnan().all(1)
        assert empty.nonzero().flatten().tolist() == [0, 7, 11]
        assert box[~empty].isfinite().all()
