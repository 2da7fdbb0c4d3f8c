#!/usr/bin/env python
"""Turn MediaPipe's tflite networks into the ONNX files that cltransfer reads.

    pip install tf2onnx tensorflow
    python tools/convert_tflite.py pose_landmark_lite.tflite blazepose.onnx --as blazepose
    cltransfer evaluate a.mp4 b.mp4 extractors.pose_blazepose.model=./blazepose.onnx

tf2onnx translates the operators and keeps TensorFlow's layout and names; this tool then turns images to channels
first and gives inputs and outputs the names that the extractor asks for, by their shapes. An .onnx that tf2onnx has
made before is taken too. Two converters never write the same bytes, so the file is not the catalogue's: name it
otherwise.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import onnx
import onnx.compose
from google.protobuf.message import DecodeError
from onnx import ModelProto, TensorProto, ValueInfoProto, helper

from cltransfer.errors import CltransferError, InputError, ModelError, ResourceError
from cltransfer.models.onnx import Network
from cltransfer.storage.files import atomic, content_hash

Shape = tuple[int, ...]


@dataclass(frozen=True)
class Interface:
    """Names by shape, channels first.

    Args:
        inputs: of the images.
        outputs: of what the extractor reads, and of what else the network gives.
    """

    inputs: dict[str, Shape]
    outputs: dict[str, Shape]


INTERFACES = {
    "blazepose": Interface(
        {"input": (1, 3, 256, 256)},
        {
            "output0": (1, 195),
            "output1": (1, 1),
            "output2": (1, 1, 256, 256),
            "output3": (1, 39, 64, 64),
            "output4": (1, 117),
        },
    ),
    "selfie": Interface({"input": (1, 3, 144, 256)}, {"output": (1, 1, 144, 256)}),
}


def fit(model: ModelProto, wanted: Interface, where: Path) -> ModelProto:
    """``model`` with the names and the layout of ``wanted``.

    Raises:
        InputError: an input or output of that shape is missing or there are several; or it is no valid network.
    """
    fitted = onnx.compose.add_prefix(model, "tf_")  # none of its names is one of ours then
    graph = fitted.graph
    before, after = [], []
    for name, shape in wanted.inputs.items():
        old, turned = matching(graph.input, name, shape, where)
        before.append(_link(name, old, (0, 2, 3, 1) if turned else None))
        graph.input.remove(old)
        graph.input.append(helper.make_tensor_value_info(name, TensorProto.FLOAT, shape))
    for name, shape in wanted.outputs.items():
        old, turned = matching(graph.output, name, shape, where)
        after.append(_link(old.name, name, (0, 3, 1, 2) if turned else None))
        graph.output.remove(old)
        graph.output.append(helper.make_tensor_value_info(name, TensorProto.FLOAT, shape))
    nodes = [*before, *graph.node, *after]
    del graph.node[:]
    graph.node.extend(nodes)
    try:
        onnx.checker.check_model(fitted)
    except onnx.checker.ValidationError as error:
        reason = f"expected a valid network, {' '.join(str(error).split())[:200]}"
        raise InputError(where, "network", reason) from None
    return fitted


def matching(values: list[ValueInfoProto], name: str, shape: Shape, where: Path) -> tuple[ValueInfoProto, bool]:
    """The one of ``values`` with ``shape``, and whether its channels are last."""
    turned = (shape[0], *shape[2:], shape[1]) if len(shape) == 4 else shape
    found = {value.name: tuple(d.dim_value for d in value.type.tensor_type.shape.dim) for value in values}
    fits = [value for value in values if found[value.name] in (shape, turned)]
    if len(fits) != 1:
        there = ", ".join(f"{key} {value}" for key, value in found.items()) or "none left"
        raise InputError(where, name, f"expected one of shape {shape} or {turned}, got {there}")
    return fits[0], found[fits[0].name] != shape


def _link(source: str | ValueInfoProto, target: str | ValueInfoProto, order: Shape | None) -> onnx.NodeProto:
    """A node from ``source`` to ``target`` that turns the axes, or just names."""
    names = [value if isinstance(value, str) else value.name for value in (source, target)]
    if order is None:
        return helper.make_node("Identity", names[:1], names[1:])
    return helper.make_node("Transpose", names[:1], names[1:], perm=order)


def translated(path: Path) -> ModelProto:
    """The network in an .onnx or .tflite file, the latter by tf2onnx.

    Raises:
        InputError: there is no such file, or it is damaged.
        ModelError: tf2onnx is not installed.
    """
    if not path.is_file():
        raise InputError(path, "network", "no such file")
    if path.suffix == ".onnx":
        try:
            return onnx.load(str(path), load_external_data=False)
        except DecodeError:
            raise InputError(path, "network", "expected ONNX, it cannot be read", "is the file whole?") from None
    try:
        import tf2onnx
    except ImportError:
        raise ModelError(path, "tf2onnx", "is not installed", "pip install tf2onnx tensorflow") from None
    return tf2onnx.convert.from_tflite(str(path), opset=13)[0]


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; a failure is one line and an exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("network", type=Path, help=".tflite, or what tf2onnx made of it")
    parser.add_argument("out", type=Path, help="ONNX file to write")
    parser.add_argument("--as", dest="interface", choices=sorted(INTERFACES), required=True)
    options = parser.parse_args(arguments)
    wanted = INTERFACES[options.interface]
    try:
        with atomic(options.out) as temporary:
            onnx.save_model(fit(translated(options.network), wanted, options.network), str(temporary))
            _ = Network(temporary, wanted.inputs, wanted.outputs).session  # loads, and has these names and shapes
    except CltransferError as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code
    except OSError as error:
        print(f"error: {error.filename or options.out}: {error.strerror or error}", file=sys.stderr)
        return ResourceError.exit_code
    print(f"{options.out} sha256 {content_hash(options.out)} {options.out.stat().st_size} bytes")
    return 0


if __name__ == "__main__":
    sys.exit(main())
