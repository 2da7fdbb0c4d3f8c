import numpy as np
import onnx
import pytest
import torch
from onnx import TensorProto, helper, numpy_helper

from cltransfer.errors import ModelError, ResourceError
from cltransfer.extractors._pixels import MOST
from cltransfer.extractors.depth_onnx import DepthOnnx, depth_from_disparity
from cltransfer.extractors.layers import Layers
from cltransfer.features import Features
from cltransfer.losses.filmic_space import FilmicSpace
from cltransfer.registry import EXTRACTORS
from cltransfer.testing import ExtractorCase

PLAIN = {"width": 32, "height": 16, "mean": [0.0, 0.0, 0.0], "std": [1.0, 1.0, 1.0]}


@pytest.fixture
def planted(tmp_path, monkeypatch):
    """A network that calls its first channel the depth (or disparity)."""
    monkeypatch.setenv("CLTRANSFER_MODELS", str(tmp_path))

    def build(channel_axis=False, batch="batch", size=(16, 32), **options):
        pick = numpy_helper.from_array(np.array([0] if channel_axis else 0), "pick")
        node = helper.make_node("Gather", ["pixel_values", "pick"], ["predicted_depth"], axis=1)
        shape = [batch, 1, *size] if channel_axis else [batch, *size]
        image = helper.make_tensor_value_info("pixel_values", TensorProto.FLOAT, [batch, 3, *size])
        depth = helper.make_tensor_value_info("predicted_depth", TensorProto.FLOAT, shape)
        graph = helper.make_graph([node], "depth", [image], [depth], [pick])
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
        onnx.save_model(model, str(tmp_path / "planted.onnx"))
        return EXTRACTORS.build("depth_onnx", {"model": "planted.onnx", **PLAIN, **options})

    return build


def halves():
    """Two frames of 64x32: red 1 on the left, 0.2 on the right; the second frame upside down in time."""
    image = torch.full((2, 3, 32, 64), 0.5)
    image[0, 0, :, :32], image[0, 0, :, 32:] = 1.0, 0.2
    image[1, 0, :, :32], image[1, 0, :, 32:] = 0.4, 0.8
    return Features((64, 32), image=image)


@pytest.mark.parametrize(("channel_axis", "batch"), [(False, "batch"), (True, "batch"), (False, 1)])
def test_disparity_is_inverted_on_the_pixels_of_the_image(planted, channel_axis, batch):
    depth = planted(channel_axis, batch, kind="disparity")(halves()).depth
    assert depth.shape == (2, 32, 64)
    sides = torch.tensor([[1.0, 5.0], [2.5, 1.25]])
    torch.testing.assert_close(depth[:, 16][:, [8, 56]], sides, atol=0.02, rtol=0)


@pytest.mark.parametrize("shape", ["whole", "row", "one"])
def test_an_output_that_is_no_map_is_refused(tmp_path, monkeypatch, shape):
    monkeypatch.setenv("CLTRANSFER_MODELS", str(tmp_path))
    axes = {"whole": [], "row": [2, 3], "one": [1, 2, 3]}[shape]
    mean = {"axes": axes, "keepdims": 0} if axes else {}
    node = helper.make_node("ReduceMean" if axes else "Identity", ["image"], ["depth"], **mean)
    image = helper.make_tensor_value_info("image", TensorProto.FLOAT, ["batch", 3, 16, 32])
    depth = helper.make_tensor_value_info("depth", TensorProto.FLOAT, ["batch", 3, 16, 32][: 4 - len(axes)])
    graph = helper.make_graph([node], "depth", [image], [depth])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    onnx.save_model(model, str(tmp_path / "odd.onnx"))
    options = {"model": "odd.onnx", "kind": "depth", "input": "image", "output": "depth", **PLAIN}
    with pytest.raises(ModelError, match=r"output depth: expected \(B, h, w\) or \(B, 1, h, w\), got \(2"):
        EXTRACTORS.build("depth_onnx", options)(halves())


def test_a_network_of_any_size_sees_the_image_in_its_aspect(planted):
    depth = planted(size=("height", "width"), kind="depth", multiple=14)(halves()).depth
    torch.testing.assert_close(depth[:, 16][:, [8, 56]], torch.tensor([[1.0, 0.2], [0.4, 0.8]]), atol=0.02, rtol=0)
    with pytest.raises(ModelError, match="input pixel_values"):
        planted(kind="depth", multiple=14, batch=2)(halves())


@pytest.mark.parametrize(
    ("image", "multiple", "expected"),
    [
        ((1280, 720), 14, (924, 518)),
        ((480, 908), 14, (518, 980)),
        ((518, 518), 14, (518, 518)),
        ((1280, 720), 0, (518, 518)),
    ],
)
def test_sides_are_the_nearest_multiples_not_below_the_least(image, multiple, expected):
    assert DepthOnnx("a.onnx", "depth", multiple=multiple)._size(*image) == expected


@pytest.mark.parametrize(("image", "striped"), [((24, 38), 2), ((72, 13), 3)])
def test_no_row_and_no_column_is_skipped_where_the_other_side_grows(planted, image, striped):
    """Stripes of one pixel; the network sees 32 x 16."""
    stripes = torch.zeros(1, 3, image[1], image[0])
    stripes[:, :, ::2] = 1.0
    stripes = stripes if striped == 2 else (torch.arange(image[0]) % 2).float().expand_as(stripes)
    seen = planted(kind="depth")._input(stripes)
    assert np.abs(seen - 0.5).max() < 0.25  # 0.5 where pixels are skipped


def test_depth_stays_and_what_is_not_positive_is_nan(planted):
    features = halves()
    features.image[1, 0, :, :32] = 0
    depth = planted(kind="depth")(features).depth
    torch.testing.assert_close(depth[0, 16, [8, 56]], torch.tensor([1.0, 0.2]), atol=2e-3, rtol=0)
    assert depth[1, 16, 8].isnan()


def test_a_frame_that_is_a_line_is_refused_before_it_takes_memory(planted, monkeypatch):
    """Its shorter side is brought to that of the network, the other one as much longer."""
    extractor = planted(size=("height", "width"), kind="depth", multiple=14, width=518, height=518)
    monkeypatch.setenv("CLTRANSFER_MEMORY", "1000")
    with pytest.raises(ResourceError, match=r"memory: frames at 124320x518 for the network need \d+ MB"):
        extractor(Features((960, 4), image=torch.zeros(1, 3, 4, 960)))


@pytest.mark.parametrize("sizes", [{"width": 0}, {"height": MOST + 1}, {"width": 2**40}])
def test_a_size_that_no_network_has_is_refused(sizes):
    with pytest.raises(ValueError, match="width and height must be 1 to 4096, got "):
        DepthOnnx("a.onnx", "depth", **sizes)
    for multiple in (-1, MOST + 1):
        with pytest.raises(ValueError, match=f"multiple must be 0 to 4096, got {multiple}"):
            DepthOnnx("a.onnx", "depth", multiple=multiple)
    assert DepthOnnx("a.onnx", "depth", width=MOST, height=MOST, multiple=MOST).width == MOST


def test_mean_and_std_are_those_of_each_channel(planted):
    depth = planted(kind="depth", mean=[0.1, 0.5, 0.5], std=[0.5, 9.0, 9.0])(halves()).depth
    torch.testing.assert_close(depth[0, 16, [8, 56]], torch.tensor([1.8, 0.2]), atol=5e-3, rtol=0)


def test_disparity_near_zero_is_no_depth():
    depth = depth_from_disparity(torch.tensor([[[10.0, 0.2, 0.09, -3.0]], [[0.0, 0.0, -1.0, -2.0]]]), floor=0.01)
    torch.testing.assert_close(depth[0, 0], torch.tensor([0.1, 5.0, torch.nan, torch.nan]), equal_nan=True)
    assert depth[1].isnan().all()


@pytest.mark.parametrize(("align", "affine"), [("shift", (1.0, 0.3)), ("metric", (0.1, 0.05)), ("metric", (1.0, -0.2))])
def test_a_shift_gives_the_sky_no_depth(planted, align, affine):
    features = halves()
    features.image[:, 0, :8] = 0.0
    depth = planted(kind="disparity", align=align, affine=affine)(features).depth
    assert depth[:, :7].isnan().all()
    assert float(depth[0, 16, 8]) == pytest.approx(1 / (affine[0] + affine[1]), rel=0.01)


def test_a_network_that_goes_below_zero_has_a_depth_there_by_its_shift():
    depth = depth_from_disparity(torch.tensor([[[1.0, -0.1, 0.0, -0.5]]]), 1e-3, "shift", (1.0, 0.3))
    torch.testing.assert_close(depth[0, 0], torch.tensor([1 / 1.3, 5.0, torch.nan, torch.nan]), equal_nan=True)
    assert depth_from_disparity(torch.full((1, 2, 2), -0.0), 1e-3, "metric", (1.0, 0.3)).isnan().all()


@pytest.mark.parametrize(("align", "affine"), [("raw", (1.0, 0.0)), ("shift", (1.0, 0.05)), ("metric", (1.0, 0.05))])
@pytest.mark.parametrize("sky", [0.05, 0.3])
def test_how_much_sky_a_frame_shows_changes_no_depth_of_its_layers(sky, align, affine):
    """A building, another behind it, the person; the sky that a network puts at disparity 0 is far behind both."""
    disparity = torch.full((1, 100, 160), 1 / 10.0)
    disparity[:, :, 100:], disparity[:, 40:, 70:90] = 1 / 15.0, 1 / 4.0
    under = torch.rand(1, 100, 160, generator=torch.Generator().manual_seed(0)) * 0.01 + disparity
    above = under.clone()
    above[:, : int(100 * sky)] = 0.0
    subject = torch.zeros(1, 100, 160, dtype=torch.bool)
    subject[:, 40:, 70:90] = True
    with_sky, without = (
        Layers()(Features((160, 100), subject=subject, depth=depth_from_disparity(each, 1e-3, align, affine)), None)
        for each in (above, under)
    )
    assert float(FilmicSpace()(without, with_sky)) < 0.05  # a tolerance; 0.163 where the sky had the largest depth


def test_options_and_foreign_networks_are_refused(planted):
    with pytest.raises(ValueError, match="kind"):
        DepthOnnx(model="a.onnx", kind="inverse")
    with pytest.raises(ValueError, match="multiple"):
        DepthOnnx(model="a.onnx", kind="depth", multiple=-1)
    with pytest.raises(ValueError, match="std"):
        DepthOnnx(model="a.onnx", kind="depth", std=(1, 1, 0))
    with pytest.raises(ModelError, match="input pixel_values"):
        planted(kind="depth", width=64)(halves())


class TestContract(ExtractorCase):
    @pytest.fixture(autouse=True)
    def use(self, planted):
        self.component = planted(kind="disparity")


def test_an_affine_takes_the_shift_out_of_a_disparity(planted):
    plain = planted(kind="disparity", align="metric", affine=[2.0, 0.5])(halves()).depth
    sides = 1 / (2 * torch.tensor([[1.0, 0.2], [0.4, 0.8]]) + 0.5)
    torch.testing.assert_close(plain[:, 16][:, [8, 56]], sides, atol=0.02, rtol=0)
    by_frame = planted(kind="disparity", align="shift", affine=[1.0, 0.5])(halves()).depth
    sides = 1 / (torch.tensor([[1.0, 0.2], [0.5, 1.0]]) + 0.5)
    torch.testing.assert_close(by_frame[:, 16][:, [8, 56]], sides, atol=0.02, rtol=0)


def test_an_alignment_of_what_has_no_shift_is_refused():
    with pytest.raises(ValueError, match="align must be raw, or shift or metric of a disparity, got 'shift' of depth"):
        DepthOnnx(model="net.onnx", kind="depth", align="shift")
    with pytest.raises(ValueError, match="affine is for align shift or metric of a disparity, got raw of disparity"):
        DepthOnnx(model="net.onnx", kind="disparity", affine=(1.0, 0.1))
    with pytest.raises(ValueError, match="got raw of depth: what is depth has no shift"):
        DepthOnnx(model="net.onnx", kind="depth", affine=(1.0, 0.1))
    with pytest.raises(ValueError, match=r"mean is of pixels in \[0, 1\], got \(123.7, .* divide it and std by 255"):
        DepthOnnx(model="net.onnx", kind="depth", mean=(123.7, 116.3, 103.5), std=(58.4, 57.1, 57.4))
    with pytest.raises(ValueError, match="affine must rise with the disparity"):
        DepthOnnx(model="net.onnx", kind="disparity", align="metric", affine=(0.0, 1.0))


def test_a_shift_that_is_taken_for_none_is_noted():
    notes = [DepthOnnx("a.onnx", kind, align=align).note for kind, align in (("disparity", "raw"), ("depth", "raw"))]
    assert notes[0].startswith("the shift of its disparity is taken for 0")
    assert [notes[1], DepthOnnx("a.onnx", "disparity", align="shift").note] == ["", ""]
