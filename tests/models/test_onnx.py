import copy
import os
import pickle
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
from onnx import TensorProto, helper, numpy_helper

from cltransfer.errors import ModelError, ResourceError, UsageError
from cltransfer.models import onnx as onnx_networks
from cltransfer.models.catalogue import catalogue
from cltransfer.models.interface import joined
from cltransfer.models.onnx import Network, _failure, providers
from cltransfer.storage.files import content_hash

KNOWN = catalogue("model")
MODELS = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "models"


def graph(path, node="Relu", batch="batch", dtype=TensorProto.FLOAT, **save):
    """y = node(x) + 2 w, with x (batch, 3) and w of ones."""
    weight = numpy_helper.from_array(np.full(3, 2, helper.tensor_dtype_to_np_dtype(dtype)), "w")
    nodes = [helper.make_node(node, ["x"], ["r"]), helper.make_node("Add", ["r", "w"], ["y"])]
    x, y = (helper.make_tensor_value_info(n, dtype, [batch, 3]) for n in "xy")
    model = helper.make_model(
        helper.make_graph(nodes, "g", [x], [y], [weight]),
        opset_imports=[helper.make_opsetid("", 17)],
        ir_version=9,
    )
    onnx.save_model(model, str(path), **save)
    return path


def network(path, inputs=None, outputs=None):
    return Network(path, inputs or {"x": (None, 3)}, outputs or {"y": (None, 3)})


def values(rows=4):
    return np.arange(rows * 3, dtype=np.float32).reshape(rows, 3) - 5


def refused(net, field, match):
    start = time.process_time()
    with pytest.raises(ModelError, match=match) as caught:
        net({"x": values()})
    assert time.process_time() - start < 2
    assert caught.value.exit_code == 4
    assert caught.value.field == field
    assert "\n" not in str(caught.value)
    assert Path(caught.value.where).name == net.path.name


@pytest.mark.parametrize("batch", ["batch", 1])
def test_runs_batches_whether_the_batch_is_free_or_one(tmp_path, batch):
    got = network(graph(tmp_path / "a.onnx", batch=batch))({"x": values()})
    np.testing.assert_array_equal(got["y"], np.maximum(values(), 0) + 2)


@pytest.mark.parametrize(("small", "threads", "at_once"), [(True, 2, 2), (True, 1, 1), (False, 2, 1)])
def test_rows_of_a_small_network_run_side_by_side_and_keep_their_order(tmp_path, monkeypatch, small, threads, at_once):
    monkeypatch.setattr(onnx_networks, "thread_count", lambda: threads)
    monkeypatch.setattr(onnx_networks, "SMALL", onnx_networks.SMALL if small else 0)
    usual, running, most, lock = Network._run, [], [], threading.Lock()

    def run(self, feeds):
        with lock:
            running.append(feeds)
            most.append(len(running))
        time.sleep(0.02)  # the others begin meanwhile
        got = usual(self, feeds)
        with lock:
            running.pop()
        return got

    monkeypatch.setattr(Network, "_run", run)
    got = network(graph(tmp_path / "a.onnx", batch=1))({"x": values(12)})
    np.testing.assert_array_equal(got["y"], np.maximum(values(12), 0) + 2)
    assert max(most) == at_once


def test_a_network_that_has_run_goes_to_another_process_and_is_copied(tmp_path):
    """Workers of a loader are begun anew on macOS and Windows."""
    net = network(graph(tmp_path / "a.onnx"))
    wanted = net({"x": values()})["y"]
    for other in (pickle.loads(pickle.dumps(net)), copy.deepcopy(net)):
        assert other == net
        np.testing.assert_array_equal(other({"x": values()})["y"], wanted)


def test_by_shape_what_has_other_names_is_known_with_channels_last_too(tmp_path):
    path = images(tmp_path / "a.onnx", {"in": (1, 2, 5, 3)}, {"score": (1, 1), "out": (1, 2, 5, 3)})
    wanted = {"image": (None, 3, 2, 5)}, {"picture": (None, 3, 2, 5), "sum": (None, 1)}
    image = np.arange(60, dtype=np.float32).reshape(2, 3, 2, 5)
    got = Network(path, *wanted, by_shape=True)({"image": image})
    np.testing.assert_array_equal(got["picture"], image + 1)
    np.testing.assert_array_equal(got["sum"], image.sum((1, 2, 3))[:, None])
    with pytest.raises(ModelError, match="expected image, got in"):
        Network(path, *wanted)({"image": image})


@pytest.mark.parametrize(
    ("inputs", "outputs", "match"),
    [
        ({"in": (1, 2, 5, 4)}, {"out": (1, 1)}, r"image: expected .*\(None, 2, 5, 3\), got in \(1, 2, 5, 4\)"),
        ({"in": (1, 3, "h", "w")}, {"out": (1, 1)}, r"image: expected .*\(None, 2, 5, 3\), got in \(1, 3, 'h', 'w'\)"),
        (
            {"in": (1, 3, 2, 5)},
            {"a": (1, 1), "b": (1, 1)},
            r"sum: expected one of shape \(None, 1\), got a \(1, 1\), b",
        ),
        ({"in": (1, 3, 2, 5), "more": (1, 3, 2, 5)}, {"a": (1, 1)}, "expected image, got in, more"),
    ],
)
def test_by_shape_what_could_be_several_or_none_is_refused(tmp_path, inputs, outputs, match):
    path = images(tmp_path / "a.onnx", inputs, outputs)
    with pytest.raises(ModelError, match=match):
        _ = Network(path, {"image": (None, 3, 2, 5)}, {"sum": (None, 1)}, by_shape=True).session


def test_by_name_an_input_that_nothing_feeds_is_refused(tmp_path):
    path = images(tmp_path / "a.onnx", {"image": (1, 3, 2, 5), "more": (1, 3, 2, 5)}, {"sum": (1, 1)})
    with pytest.raises(ModelError, match="inputs: expected image, got image, more"):
        _ = Network(path, {"image": (None, 3, 2, 5)}, {"sum": (None, 1)}).session


def images(path, inputs, outputs):
    """An image plus 1 for every output of its rank, and its sum for the others."""
    first = next(iter(inputs))
    nodes = [
        helper.make_node("Add", [first, "one"], [name])
        if len(shape) == 4
        else helper.make_node("ReduceSum", [first, "axes"], [f"{name}_4"], keepdims=1)
        for name, shape in outputs.items()
    ]
    flat = [name for name, shape in outputs.items() if len(shape) != 4]
    nodes += [helper.make_node("Flatten", [f"{name}_4"], [name]) for name in flat]
    known = {"one": np.ones(1, np.float32), "axes": np.array([1, 2, 3])}
    ins, outs = (
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name, shape in values.items()]
        for values in (inputs, outputs)
    )
    made = helper.make_graph(nodes, "g", ins, outs, [numpy_helper.from_array(v, n) for n, v in known.items()])
    onnx.save_model(helper.make_model(made, opset_imports=[helper.make_opsetid("", 17)], ir_version=9), str(path))
    return path


def test_files_that_are_no_network_are_refused(tmp_path):
    (tmp_path / "a.onnx").write_bytes(b"garbage" * 99)
    refused(network(tmp_path / "a.onnx"), "model", "protobuf")
    refused(network(tmp_path / "none.onnx"), "model", "no such file")


def test_other_names_shapes_types_and_batches_are_refused(tmp_path):
    path = graph(tmp_path / "a.onnx")
    refused(network(path, inputs={"image": (None, 3)}), "inputs", "expected image, got x")
    refused(network(path, outputs={"z": (None, 3)}), "outputs", "expected z, got y")
    refused(network(path, inputs={"x": (None, 4)}), "input x", r"expected shape \(None, 4\)")
    refused(network(path, outputs={"y": (None, 3, 1)}), "output y", "expected shape")
    refused(network(graph(tmp_path / "d.onnx", dtype=TensorProto.DOUBLE)), "input x", "double")
    refused(network(graph(tmp_path / "b.onnx", batch=2)), "input x", "batch of 1 or free, got 2")


def test_outputs_that_are_not_finite_are_refused(tmp_path):
    refused(network(graph(tmp_path / "a.onnx", node="Log")), "output y", "not finite")


def test_outputs_without_a_row_for_each_input_are_refused(tmp_path):
    x = helper.make_tensor_value_info("x", TensorProto.FLOAT, ["batch", 3])
    y = helper.make_tensor_value_info("y", TensorProto.FLOAT, None)
    node = helper.make_node("ReduceSum", ["x"], ["y"], keepdims=0)
    model = helper.make_model(
        helper.make_graph([node], "g", [x], [y]), opset_imports=[helper.make_opsetid("", 17)], ir_version=9
    )
    onnx.save_model(model, str(tmp_path / "a.onnx"))
    refused(network(tmp_path / "a.onnx", outputs={"y": None}), "output y", "a row for each input, got a single value")
    with pytest.raises(ModelError, match=r"rows of one shape, got \[\(2,\), \(3,\)\]"):
        joined(tmp_path, "y", [np.zeros((1, 2)), np.zeros((1, 3))])


def test_an_error_that_says_nothing_is_told_by_its_kind(tmp_path):
    failure = _failure(tmp_path / "a.onnx", "run", RuntimeError(""))
    assert str(failure).endswith("run: RuntimeError")


def test_external_data_are_refused(tmp_path):
    path = graph(tmp_path / "a.onnx", save_as_external_data=True, location="w.bin", size_threshold=0)
    assert (tmp_path / "w.bin").exists()
    refused(network(path), "external data", "refused")


def test_networks_that_use_text_are_refused_before_they_run(tmp_path, monkeypatch):
    """A text doubled n times is of 2^n letters, and repeated it is of any length; no arena holds either."""
    monkeypatch.setattr("onnxruntime.InferenceSession", lambda *values, **options: pytest.fail("was loaded"))
    node = helper.make_node
    doubled = [node("StringConcat", [f"s{i}", f"s{i}"], [f"s{i + 1}"]) for i in range(28)]
    strings = [
        node("Cast", ["x"], ["s0"], to=TensorProto.STRING), *doubled,
        node("Equal", ["s28", "s0"], ["e"]), node("Cast", ["e"], ["y"], to=TensorProto.FLOAT),
    ]  # fmt: skip
    tiles = [
        node("Tile", ["k", "n"], ["large"]), node("Equal", ["large", "k"], ["e"]),
        node("Cast", ["e"], ["f"], to=TensorProto.FLOAT), node("ReduceSum", ["f"], ["z"], keepdims=0),
        node("Add", ["x", "z"], ["y"]),
    ]  # fmt: skip
    k, n = (helper.make_tensor("k", TensorProto.STRING, [1], [b"long"]), helper.make_tensor("n", 7, [1], [2**30]))
    x, y = (helper.make_tensor_value_info(n, TensorProto.FLOAT, ["batch", 3]) for n in "xy")
    for nodes, known in ((strings, []), (tiles, [k, n])):
        made = helper.make_graph(nodes, "g", [x], [y], known)
        opset = [helper.make_opsetid("", 20)]
        onnx.save_model(helper.make_model(made, opset_imports=opset, ir_version=9), str(tmp_path / "a.onnx"))
        refused(network(tmp_path / "a.onnx"), "text", "tensors of text are refused")


def test_a_network_in_a_format_that_is_not_looked_into_is_refused(tmp_path, monkeypatch):
    options = onnxruntime.SessionOptions()
    options.log_severity_level, options.optimized_model_filepath = 4, str(tmp_path / "a.ort")
    options.add_session_config_entry("session.save_model_format", "ORT")
    onnxruntime.InferenceSession(str(graph(tmp_path / "a.onnx")), options)
    (tmp_path / "a.ort").rename(tmp_path / "b.onnx")
    refused(network(tmp_path / "b.onnx"), "model", "protobuf")
    monkeypatch.setattr("cltransfer.models.onnx._refuse_unbounded", lambda *_: None)  # as of one that is both
    refused(network(tmp_path / "b.onnx"), "model", "[Pp]rotobuf parsing failed")


def test_sparse_tensors_are_refused_before_they_are_made_dense(tmp_path, monkeypatch):
    """A weight or a constant of 2 GB that is written in some 50 bytes, as what it is not 0 in."""
    monkeypatch.setattr("onnxruntime.InferenceSession", lambda *values, **options: pytest.fail("was loaded"))
    place = helper.make_tensor("i", TensorProto.INT64, [1], [0])
    large = onnx.SparseTensorProto(
        values=helper.make_tensor("large", TensorProto.FLOAT, [1], [1.0]), indices=place, dims=[2**29]
    )
    constant = helper.make_node("Constant", [], ["large"], sparse_value=large)
    for nodes, weights in (([], [large]), ([constant], [])):
        save(tmp_path / "a.onnx", [*nodes, *summed("large")], [], sparse_initializer=weights)
        refused(network(tmp_path / "a.onnx"), "sparse", "sparse tensors are refused")


def summed(large):
    """Nodes of y = x + the sum of the roots of ``large``."""
    return [
        helper.make_node("Sqrt", [large], ["root"]),
        helper.make_node("ReduceSum", ["root"], ["sum"], keepdims=0),
        helper.make_node("Add", ["x", "sum"], ["y"]),
    ]


def save(path, nodes, known, **weights):
    """A network of x (batch, 3) to y."""
    x, y = (helper.make_tensor_value_info(n, TensorProto.FLOAT, ["batch", 3]) for n in "xy")
    model = helper.make_model(
        helper.make_graph(nodes, "g", [x], [y], known, **weights),
        opset_imports=[helper.make_opsetid("", 17)],
        ir_version=9,
    )
    onnx.save_model(model, str(path))


GREEDY = """
import resource, sys
import numpy as np
from pathlib import Path
from cltransfer.errors import CltransferError
from cltransfer.models import onnx
from cltransfer.models.onnx import Network
if sys.argv[2:]:
    onnx.free_bytes = lambda: int(sys.argv[2])
net = Network(Path(sys.argv[1]), {"x": (None, 3)}, {"y": (None, 3)})
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for step in (lambda: net.session, lambda: net({"x": np.ones((1, 3), np.float32)})):
    try:
        step()
        print("went")
    except CltransferError as error:
        print(error.field, error)
    print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024)
"""


def greedy(path, limit, *left):
    """What loading and then running a network say, and how much each has taken at most until then [MB]."""
    ran = subprocess.run(
        [sys.executable, "-c", GREEDY, str(path), *left],
        env={**os.environ, "CLTRANSFER_MEMORY": limit}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    loaded, at_load, told, taken = ran.stdout.splitlines()
    return loaded, int(at_load), told, int(taken)


@pytest.mark.parametrize(
    ("limit", "left"),
    [("800", []), ("10", []), ("800", ["1"])],
    ids=["while it runs", "where nothing is", "where nothing is left once it is read"],
)
def test_a_network_takes_no_more_memory_than_is_free(tmp_path, limit, left):
    """A file of 200 bytes that asks for 2 GB."""
    nodes = [helper.make_node("ReduceSum", ["x"], ["s"], keepdims=0), helper.make_node("Expand", ["s", "n"], ["large"])]
    save(tmp_path / "a.onnx", [*nodes, *summed("large")], [numpy_helper.from_array(np.array([2**29]), "n")])
    *_, told, taken = greedy(tmp_path / "a.onnx", limit, *left)
    assert told.startswith("memory ")
    assert "raise the limit of the system or of CLTRANSFER_MEMORY" in told
    assert taken < 400


@pytest.mark.parametrize("node", ["ConstantOfShape", "Expand", "Tile"])
def test_a_network_that_is_loaded_takes_no_more_memory_than_is_free(tmp_path, node):
    """A file of 200 bytes whose constants alone make 600 MB, which onnxruntime would work out in advance."""
    known = {"n": np.array([150 * 2**20]), "c": np.ones(1, np.float32)}
    large = helper.make_node(node, ["n"] if node == "ConstantOfShape" else ["c", "n"], ["large"])
    tensors = [numpy_helper.from_array(value, name) for name, value in known.items()]
    save(tmp_path / "a.onnx", [large, *summed("large")], tensors)
    loaded, at_load, told, taken = greedy(tmp_path / "a.onnx", "400")
    assert loaded == "went"
    assert told.startswith("memory ")
    assert max(at_load, taken) < 300


def test_only_what_the_catalogue_knows_is_worked_out_in_advance(tmp_path, monkeypatch):
    off = []
    session = onnxruntime.InferenceSession
    monkeypatch.setattr(
        "onnxruntime.InferenceSession", lambda *v, **o: (off.append(o["disabled_optimizers"]), session(*v, **o))[1]
    )
    path = graph(tmp_path / "own.onnx")
    wanted = network(path)({"x": values()})["y"]
    entry = f"{{file: own.onnx, task: t, licence: l, source: s, sha256: {content_hash(path)}}}"
    (tmp_path / "own.yaml").write_text(f"models: {{own: {entry}}}")
    monkeypatch.setenv("CLTRANSFER_CATALOGUE", str(tmp_path / "own.yaml"))
    np.testing.assert_array_equal(network(path)({"x": values()})["y"], wanted)
    assert off == [["ConstantFolding"], []]


def test_a_network_that_there_is_no_memory_to_load_is_not_read(tmp_path, monkeypatch):
    with (tmp_path / "a.onnx").open("wb") as stream:
        stream.truncate(60 * 2**20)
    monkeypatch.setattr(Path, "read_bytes", lambda path: pytest.fail("was read"))
    monkeypatch.setattr("cltransfer.computer.memory.free_bytes", lambda: 150 * 2**20)
    told = r"a\.onnx: memory: its weights need 180 MB, 150 MB are free \(raise the limit .* or take a smaller network\)"
    with pytest.raises(ResourceError, match=told):
        network(tmp_path / "a.onnx")({"x": values()})


def field(tag, content):
    """A protobuf field of bytes; its length fits in two bytes."""
    return bytes([tag, len(content) % 128 + 128, len(content) // 128]) + content


def test_external_data_are_out_of_reach_when_their_key_is_written_oddly(tmp_path, monkeypatch):
    model = onnx.load(str(graph(tmp_path / "a.onnx")))
    weight = TensorProto(name="w", dims=[3], data_type=TensorProto.FLOAT, data_location=TensorProto.EXTERNAL)
    del model.graph.initializer[:]
    rest = model.graph.SerializeToString()
    model.ClearField("graph")
    location = field(0x0A, b"location") + field(0x12, b"w.bin")  # tag, overlong length, text
    data = rest + field(0x2A, weight.SerializeToString() + field(0x6A, location))
    (tmp_path / "odd.onnx").write_bytes(model.SerializeToString() + field(0x3A, data))
    (tmp_path / "w.bin").write_bytes(np.ones(3, np.float32).tobytes())
    monkeypatch.chdir(tmp_path)
    assert onnx.load("odd.onnx").graph.initializer[0].raw_data  # an ordinary reader follows the name
    refused(network(tmp_path / "odd.onnx"), "model", "External data")


def test_a_known_name_with_other_content_is_refused(tmp_path):
    refused(network(graph(tmp_path / "yolox_nano.onnx")), "sha256", KNOWN["yolox_nano"].sha256)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.needs(f"models/{entry.file}"))
        for name, entry in sorted(KNOWN.items())
        if entry.sha256 and not entry.stands_in_for
    ],
)
def test_the_shared_networks_are_the_known_ones(name):
    assert content_hash(MODELS / KNOWN[name].file) == KNOWN[name].sha256
    assert (MODELS / KNOWN[name].file).stat().st_size == KNOWN[name].size


def test_networks_run_where_the_variable_says(monkeypatch, tmp_path):
    monkeypatch.setenv("CLTRANSFER_NETWORKS", "cpu")
    assert providers() == ["CPUExecutionProvider"]
    monkeypatch.setenv("CLTRANSFER_NETWORKS", "npu")
    with pytest.raises(UsageError, match="expected auto, cpu or cuda"):
        providers()


@pytest.mark.skipif("CUDAExecutionProvider" in onnxruntime.get_available_providers(), reason="onnxruntime has CUDA")
def test_cuda_is_never_silently_replaced(monkeypatch, tmp_path):
    assert providers() == ["CPUExecutionProvider"]
    monkeypatch.setenv("CLTRANSFER_NETWORKS", "cuda")
    with pytest.raises(ModelError, match="not built for CUDA"):
        network(graph(tmp_path / "a.onnx"))({"x": values()})
    listed = ["CUDAExecutionProvider", "CPUExecutionProvider"]
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: listed)  # a build whose driver is missing
    refused(network(graph(tmp_path / "a.onnx")), "CUDA", "did not start")
