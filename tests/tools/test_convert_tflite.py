from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import onnx
import pytest
import torch
from onnx import TensorProto, helper

from cltransfer.extractors.segment_selfie import SegmentSelfie
from cltransfer.features import Features
from cltransfer.models.onnx import Network

TOOL = Path(__file__).resolve().parents[2] / "tools" / "convert_tflite.py"


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    spec = importlib.util.spec_from_file_location("convert_tflite", TOOL)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def value(name, *shape):
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)


def saved(path, nodes, inputs, outputs):
    graph = helper.make_graph(nodes, "tf", inputs, outputs)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    onnx.save_model(model, str(path))
    return path


def channels_last_selfie(path):
    """As tf2onnx would write it: the image with its channels last, and the red channel as the probability."""
    nodes = [helper.make_node("Split", ["input_1"], ["red", "green", "blue"], axis=3)]
    nodes.append(helper.make_node("Identity", ["red"], ["activation_10"]))
    return saved(path, nodes, [value("input_1", 1, 144, 256, 3)], [value("activation_10", 1, 144, 256, 1)])


def test_a_channels_last_network_is_read_by_the_extractor(tool, tmp_path, monkeypatch, capsys):
    raw = channels_last_selfie(tmp_path / "raw.onnx")
    assert tool.main([str(raw), str(tmp_path / "selfie.onnx"), "--as", "selfie"]) == 0
    assert "sha256" in capsys.readouterr().out
    monkeypatch.setenv("CLTRANSFER_MODELS", str(tmp_path))
    image = torch.zeros(1, 3, 144, 256)
    image[0, 0, 20:60, 100:150] = 1
    got = SegmentSelfie("selfie.onnx")(Features((256, 144), image=image)).subject
    assert torch.equal(got[0], image[0, 0] > 0.5)


def test_a_network_that_fits_already_stays_as_it_is(tool, tmp_path):
    channels_last_selfie(tmp_path / "raw.onnx")
    for source, target in (("raw", "once"), ("once", "twice")):
        assert tool.main([str(tmp_path / f"{source}.onnx"), str(tmp_path / f"{target}.onnx"), "--as", "selfie"]) == 0
    wanted, image = tool.INTERFACES["selfie"], np.random.default_rng(0).random((1, 3, 144, 256), np.float32)
    for name in ("once", "twice"):
        got = Network(tmp_path / f"{name}.onnx", wanted.inputs, wanted.outputs)({"input": image})
        np.testing.assert_array_equal(got["output"][:, 0], image[:, 0])


def test_outputs_are_told_apart_by_their_shapes_in_any_order(tool, tmp_path):
    """A stand-in for BlazePose whose every output is the mean of the image plus a number of its own."""
    shapes = {"heat": (1, 64, 64, 39), "world": (1, 117), "flag": (1, 1), "ld": (1, 195), "mask": (1, 256, 256, 1)}
    nodes = [helper.make_node("ReduceMean", ["input_1"], ["mean"], axes=[1, 2, 3], keepdims=0)]
    for number, (name, shape) in enumerate(shapes.items()):
        tensor = helper.make_tensor(
            f"{name}_add", TensorProto.FLOAT, shape, np.full(np.prod(shape), number, np.float32)
        )
        nodes.append(helper.make_node("Constant", [], [f"{name}_add"], value=tensor))
        nodes.append(helper.make_node("Add", ["mean", f"{name}_add"], [name]))
    outputs = [value(name, *shape) for name, shape in shapes.items()]
    raw = saved(tmp_path / "raw.onnx", nodes, [value("input_1", 1, 256, 256, 3)], outputs)
    assert tool.main([str(raw), str(tmp_path / "pose.onnx"), "--as", "blazepose"]) == 0
    wanted = tool.INTERFACES["blazepose"]
    got = Network(tmp_path / "pose.onnx", wanted.inputs, wanted.outputs)(
        {"input": np.full((1, 3, 256, 256), 0.5, np.float32)}
    )
    assert {name: float(part.mean()) for name, part in got.items()} == pytest.approx(
        {"output0": 3.5, "output1": 2.5, "output2": 4.5, "output3": 0.5, "output4": 1.5}
    )


def test_what_is_another_network_is_refused_in_one_line_and_nothing_is_kept(tool, tmp_path, capsys):
    raw = channels_last_selfie(tmp_path / "raw.onnx")
    assert tool.main([str(raw), str(tmp_path / "out.onnx"), "--as", "blazepose"]) == 3
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "input_1 (1, 144, 256, 3)" in said
    assert tool.main([str(tmp_path / "none.tflite"), str(tmp_path / "out.onnx"), "--as", "selfie"]) == 3
    assert sorted(path.name for path in tmp_path.iterdir()) == ["raw.onnx"]


def test_a_damaged_network_and_a_folder_that_cannot_be_made_are_one_line(tool, tmp_path, capsys):
    raw = channels_last_selfie(tmp_path / "raw.onnx")
    (tmp_path / "bad.onnx").write_bytes(raw.read_bytes()[:-40])
    unknown = [helper.make_node("Nonesuch", ["input_1"], ["activation_10"])]
    wrong = saved(
        tmp_path / "wrong.onnx", unknown, [value("input_1", 1, 144, 256, 3)], [value("activation_10", 1, 144, 256, 1)]
    )
    for name, out, code, line in (
        ("bad.onnx", "out.onnx", 3, "bad.onnx: network: expected ONNX, it cannot be read (is the file whole?)\n"),
        ("wrong.onnx", "out.onnx", 3, "wrong.onnx: network: expected a valid network, No Op registered for Nonesuch"),
        ("raw.onnx", "raw.onnx/out.onnx", 5, f"error: {raw}: "),
    ):
        assert tool.main([str(tmp_path / name), str(tmp_path / out), "--as", "selfie"]) == code
        said = capsys.readouterr().err
        assert said.startswith("error: ")
        assert said.count("\n") == 1
        assert line in said
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bad.onnx", "raw.onnx", wrong.name]


@pytest.mark.skipif(importlib.util.find_spec("tf2onnx") is not None, reason="tf2onnx is installed")
def test_without_tf2onnx_the_line_says_how_to_get_it(tool, tmp_path, capsys):
    (tmp_path / "a.tflite").write_bytes(b"TFL3")
    assert tool.main([str(tmp_path / "a.tflite"), str(tmp_path / "out.onnx"), "--as", "selfie"]) == 4
    assert "pip install tf2onnx" in capsys.readouterr().err
