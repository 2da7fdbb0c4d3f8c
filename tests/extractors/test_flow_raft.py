import numpy as np
import pytest
import torch

from cltransfer.errors import ModelError, ResourceError
from cltransfer.extractors._pixels import MOST
from cltransfer.extractors.flow_raft import FlowRaft, padded
from cltransfer.features import Features
from cltransfer.testing import ExtractorCase

SIZE = (150, 132)  # no multiples of 8: padded to 152 x 136
WIDE = (152, 136)


@pytest.fixture
def planted(network, node):
    """RAFT whose flow is how far the middle of the red went from image1 to image2, plus 10 px down where blue."""

    def build(batch="batch", wide=WIDE, **options):
        y, x = np.mgrid[: wide[1], : wide[0]]
        constants = {
            "red": np.float32([1, -0.5, -0.5]).reshape(1, 3, 1, 1) / 255,
            "blue": np.stack([np.zeros(3), [-0.5, -0.5, 1]]).reshape(2, 3, 1, 1).astype(np.float32) * 10 / 255,
            "grid": np.stack([x, y])[None].astype(np.float32),
            "axes": np.array([2, 3]),
        }
        nodes = []
        for image in ("image1", "image2"):
            nodes += [
                node("Conv", f"{image} red", f"{image}_signed"),
                node("Relu", f"{image}_signed", f"{image}_red"),
                node("ReduceSum", f"{image}_red axes", f"{image}_all"),
                node("Mul", f"{image}_red grid", f"{image}_moment"),
                node("ReduceSum", f"{image}_moment axes", f"{image}_first"),
                node("Div", f"{image}_first {image}_all", f"{image}_middle"),
            ]
        nodes += [
            node("Sub", "image2_middle image1_middle", "shift"),
            node("Conv", "image1 blue", "signed"),
            node("Relu", "signed", "down"),
            node("Add", "shift down", "flow"),
        ]
        shape = [batch, 3, wide[1], wide[0]]
        inputs = {"image1": shape, "image2": shape}
        model = network(nodes, inputs, {"flow": [batch, 2, wide[1], wide[0]]}, constants)
        return FlowRaft(model, **options)

    return build


def frame(middle, size=SIZE):
    """A red square of 20 px about ``middle`` on grey, the right third blue."""
    image = torch.full((1, 3, size[1], size[0]), 0.4)
    image[:, :, :, 2 * size[0] // 3 :] = torch.tensor([0, 0, 1.0])[:, None, None]
    x, y = middle
    image[:, :, y - 10 : y + 10, x - 10 : x + 10] = torch.tensor([1.0, 0, 0])[:, None, None]
    return image


def features(*images, size=SIZE):
    return Features(size, image=torch.cat(images))


@pytest.mark.parametrize("batch", ["batch", 1])
def test_flow_points_back_to_where_things_were(planted, batch):
    now, before = features(frame((50, 60)), frame((40, 90))), features(frame((43, 64)), frame((45, 80)))
    flow = planted(batch).__call__(now, before).flow
    assert flow.shape == (2, 2, SIZE[1], SIZE[0])
    expected = torch.tensor([[-7.0, 4.0], [5.0, -10.0]])
    torch.testing.assert_close(flow[:, :, 20, 20], expected, atol=0.02, rtol=0)


@pytest.mark.parametrize("size", [SIZE, (151, 133)])
def test_the_map_lies_on_the_pixels_of_the_image_without_the_padding(planted, size):
    still = features(frame((50, 60), size), size=size)
    flow, blue = planted(check=False)(still, still).flow, still.image[0, 2] == 1
    torch.testing.assert_close(flow[0, 1], 10.0 * blue, atol=1e-3, rtol=0)
    torch.testing.assert_close(flow[0, 0], torch.zeros(size[::-1]), atol=1e-3, rtol=0)


def test_vectors_are_in_pixels_of_the_features_size(planted):
    now, before = features(frame((50, 60)), size=(300, 396)), features(frame((43, 64)), size=(300, 396))
    flow = planted()(now, before).flow
    torch.testing.assert_close(flow[0, :, 20, 20], torch.tensor([-14.0, 12.0]), atol=0.05, rtol=0)


def test_large_frames_are_shrunk_to_the_height_and_vectors_rescaled(planted):
    now, before = frame((100, 120), (300, 264)), frame((86, 128), (300, 264))
    flow = planted(height=132)(features(now, size=(300, 264)), features(before, size=(300, 264))).flow
    assert flow.shape == (1, 2, 264, 300)
    torch.testing.assert_close(flow[0, :, 20, 20], torch.tensor([-14.0, 8.0]), atol=0.1, rtol=0)


def test_a_network_of_one_size_gets_frames_of_that_size(planted):
    raft = planted(1, (136, 160), height=160, width=136)
    flow = raft(features(frame((50, 60))), features(frame((43, 64)))).flow
    torch.testing.assert_close(flow[0, :, 20, 20], torch.tensor([-7.0, 4.0]), atol=0.1, rtol=0)


def test_one_frame_before_serves_a_batch(planted):
    now, before = features(frame((50, 60)), frame((40, 90))), features(frame((43, 64)))
    flow = planted()(now, before).flow
    torch.testing.assert_close(flow[:, :, 20, 20], torch.tensor([[-7.0, 4.0], [3.0, -26.0]]), atol=0.02, rtol=0)


def test_the_way_back_checks_the_way_there(planted):
    got = planted()(features(frame((50, 60))), features(frame((43, 64))))
    assert got.flow_confidence.shape == (1, SIZE[1], SIZE[0])
    assert got.flow_confidence[0, 60, 50] > 0.95  # there and back are opposite
    assert got.flow_confidence[0, 60, 120] < 0.01  # blue: 10 px down both ways
    assert got.flow_confidence[0, 60, 3] == 0  # leads out of the frame
    assert not planted(check=False)(features(frame((50, 60))), features(frame((43, 64)))).has("flow_confidence")
    assert (planted().passes, planted(check=False).passes) == (2, 1)


def test_a_frame_without_one_before_is_nan(planted):
    got = planted()(features(frame((50, 60))), None)
    assert got.flow.isnan().all()
    assert got.flow_confidence.isnan().all()


def test_padding_repeats_the_edges_on_both_sides_in_bytes_and_rgb():
    image = torch.rand(1, 3, 132, 150, generator=torch.Generator().manual_seed(0))
    wide = padded(image, SIZE)
    assert wide.shape == (1, 3, 136, 152)
    np.testing.assert_allclose(wide[0, :, 2:-2, 1:-1], (image[0] * 255).round().numpy(), atol=0.51)
    np.testing.assert_array_equal(wide[:, :, :2], wide[:, :, 2:3].repeat(2, 2))
    np.testing.assert_array_equal(wide[..., -1], wide[..., -2])


def test_no_row_of_a_portrait_clip_is_skipped_by_a_network_of_one_wide_size():
    image = torch.zeros(1, 3, 908, 480)
    image[:, :, ::2] = 1.0
    wide = padded(image, (768, 432))
    assert wide.shape == (1, 3, 432, 768)
    assert np.abs(wide - 127.5).max() < 32  # 0.05 of a row more or less in 2.1; up to 127 where rows are skipped


def test_small_frames_are_grown_to_what_the_network_needs(planted):
    assert FlowRaft("a.onnx")._size(160, 90) == (228, 128)
    assert FlowRaft("a.onnx")._size(1920, 1080) == (768, 432)


def test_options_and_coarse_outputs_are_refused(planted, network, node):
    with pytest.raises(ValueError, match="height"):
        FlowRaft("a.onnx", height=64)
    shape = ["batch", 3, 136, 152]
    nodes = [
        node("Sub", "image2 image1", "both"),
        node("AveragePool", "both", "small", kernel_shape=[8, 8], strides=[8, 8]),
        node("Gather", "small two", "flow", axis=1),
    ]
    model = network(
        nodes, {"image1": shape, "image2": shape}, {"flow": ["batch", 2, 17, 19]}, {"two": np.array([0, 1])}
    )
    with pytest.raises(ModelError, match="eighth"):
        FlowRaft(model)(features(frame((50, 60))), features(frame((43, 64))))


class TestContract(ExtractorCase):
    @pytest.fixture(autouse=True)
    def use(self, planted):
        self.component = planted(wide=(232, 128))  # frames of 64 x 36 grow to 228 x 128


@pytest.mark.parametrize("size", [(127, None), (MOST + 1, None), (432, 0), (432, 2**40)])
def test_a_size_that_no_network_has_is_refused(size):
    with pytest.raises(ValueError, match=f"height and width must be 128 to 4096, got {size[0]} and {size[1]}"):
        FlowRaft("a.onnx", *size)
    assert FlowRaft("a.onnx", MOST, MOST).width == MOST


def test_a_frame_that_is_a_line_is_refused_before_it_takes_memory(monkeypatch):
    """Its shorter side is brought to the least that the network sees, the other one as much longer."""
    line = Features((6000, 1), image=torch.zeros(1, 3, 1, 6000))
    monkeypatch.setenv("CLTRANSFER_MEMORY", "1000")
    with pytest.raises(ResourceError, match=r"memory: frames at 768000x128 for the network need 6000 MB"):
        FlowRaft("a.onnx")(line, line)
