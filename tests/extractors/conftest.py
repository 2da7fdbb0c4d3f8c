"""Tiny networks with the names and shapes of published ones, whose right answer is known."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import NodeProto, TensorProto, helper, numpy_helper

Shapes = Mapping[str, Sequence[int | str]]
Build = Callable[[Sequence[NodeProto], Shapes, Shapes, Mapping[str, Any]], str]


@pytest.fixture
def network(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Build:
    """Save a graph of nodes, inputs, outputs and constants where models are looked for; gives its name."""
    monkeypatch.setenv("CLTRANSFER_MODELS", str(tmp_path))

    def build(nodes: Sequence[NodeProto], inputs: Shapes, outputs: Shapes, constants: Mapping[str, Any]) -> str:
        def values(shapes: Shapes) -> list[Any]:
            return [helper.make_tensor_value_info(n, TensorProto.FLOAT, s) for n, s in shapes.items()]

        weights = [numpy_helper.from_array(np.asarray(value), name) for name, value in constants.items()]
        graph = helper.make_graph(nodes, "planted", values(inputs), values(outputs), weights)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
        onnx.checker.check_model(model)
        onnx.save_model(model, str(tmp_path / "planted.onnx"))
        return "planted.onnx"

    return build


@pytest.fixture
def node() -> Callable[..., NodeProto]:
    """Shorthand for a graph's node: operator, inputs, output, attributes."""

    def make(operator: str, inputs: str, output: str, **attributes: Any) -> NodeProto:
        return helper.make_node(operator, inputs.split(), [output], **attributes)

    return make
