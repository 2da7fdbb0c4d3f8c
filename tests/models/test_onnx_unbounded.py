import onnx
import pytest
from onnx import TensorProto, TypeProto, helper
from onnx.onnx_ml_pb2 import ModelProto

from cltransfer.models.onnx_unbounded import FIELDS, TYPE_FIELDS, is_sparse, uses_text

TEXT, FLOAT = TensorProto.STRING, TensorProto.FLOAT
LABEL = helper.make_tensor("label", TEXT, [1], [b"cat"])


def node(kind="Identity", **attributes):
    return helper.make_node(kind, ["x"], ["y"], **attributes)


def model(*nodes, values=(), functions=(), **parts):
    x, y = (helper.make_tensor_value_info(name, FLOAT, [1]) for name in "xy")
    graph = helper.make_graph(nodes, "g", [x], [y], value_info=values, **parts)
    return helper.make_model(graph, functions=functions).SerializeToString()


def function(name, *nodes, attributes=(), defaults=()):
    opset = [helper.make_opsetid("", 17)]
    return helper.make_function("own", name, ["x"], ["y"], nodes, opset, attributes, defaults)


def called(kind, own, functions_own):
    """A node whose attribute ``own`` is what the function around it calls ``functions_own``."""
    made = node(kind)
    made.attribute.add(name=own, ref_attr_name=functions_own, type=onnx.AttributeProto.INT)
    return made


def branch(*nodes):
    return helper.make_graph(nodes, "b", [], [helper.make_tensor_value_info("y", FLOAT, [1])])


def typed(**kind):
    return helper.make_value_info("v", TypeProto(**kind))


ELEMENTS = TypeProto(tensor_type=TypeProto.Tensor(elem_type=TEXT))
SPARSE = onnx.SparseTensorProto(values=LABEL, indices=helper.make_tensor("i", TensorProto.INT64, [1], [0]), dims=[3])
CASTS = (
    function("inner", called("Cast", "to", "kind")),
    function("outer", called("inner", "kind", "what"), attributes=["what"]),
)


@pytest.mark.parametrize(
    "data",
    {
        "cast": model(node("Cast", to=TEXT)),
        "empty sequence": model(node("SequenceEmpty", dtype=TEXT)),
        "initializer": model(node(), initializer=[LABEL]),
        "sparse initializer": model(node(), sparse_initializer=[SPARSE]),
        "constant": model(node("Constant", value=LABEL)),
        "sparse constant": model(node("Constant", sparse_value=SPARSE)),
        "text": model(node("Constant", value_string="cat")),
        "texts": model(node("Constant", value_strings=["cat", "dog"])),
        "labels": model(node("LabelEncoder", keys_int64s=[1], values_strings=["cat"])),
        "elements": model(node(), values=[typed(tensor_type=TypeProto.Tensor(elem_type=TEXT))]),
        "sparse elements": model(node(), values=[typed(sparse_tensor_type=TypeProto.SparseTensor(elem_type=TEXT))]),
        "sequence": model(node(), values=[typed(sequence_type=TypeProto.Sequence(elem_type=ELEMENTS))]),
        "optional": model(node(), values=[typed(optional_type=TypeProto.Optional(elem_type=ELEMENTS))]),
        "keys": model(node(), values=[typed(map_type=TypeProto.Map(key_type=TEXT))]),
        "type": model(node("Optional", type=ELEMENTS)),
        "branch": model(node("If", then_branch=branch(node("If", then_branch=branch(node("Cast", to=TEXT)))))),
        "function": model(node(), functions=[function("f", node("Cast", to=TEXT))]),
        "of a function": model(node("outer", what=TEXT), functions=CASTS),
        "default": model(
            node("outer"), functions=[*CASTS, function("f", defaults=[helper.make_attribute("what", TEXT)])]
        ),
        "odd number": model(node("Cast", to=TEXT + 2**32)),
    }.items(),
    ids=lambda case: case[0],
)
def test_every_way_by_which_text_comes_into_a_network_is_seen(data):
    assert uses_text(data[1])


@pytest.mark.parametrize(
    "data",
    [
        model(node("Resize", mode="linear"), node("LSTM", activations=["Tanh"]), node("Cast", to=FLOAT)),
        model(node("Concat", axis=TEXT), node("Pad", pads=[TEXT])),
        model(node("outer", what=FLOAT), node("other", axis=TEXT), functions=CASTS),
        model(node(), initializer=[helper.make_tensor("w", FLOAT, [8], [8.0] * 8)], doc_string="string"),
    ],
)
def test_settings_in_words_and_numbers_that_happen_to_be_that_of_text_are_no_text(data):
    assert not uses_text(data)


NUMBERS = onnx.SparseTensorProto(
    values=helper.make_tensor("v", FLOAT, [1], [1.0]), indices=helper.make_tensor("i", TensorProto.INT64, [1], [0]),
    dims=[3],
)  # fmt: skip


@pytest.mark.parametrize(
    "data",
    {
        "weight": model(node(), sparse_initializer=[NUMBERS]),
        "constant": model(node("Constant", sparse_value=NUMBERS)),
        "constants": model(node("own", several=[NUMBERS, NUMBERS])),
        "branch": model(node("If", then_branch=branch(node("Constant", sparse_value=NUMBERS)))),
        "function": model(node(), functions=[function("f", node("Constant", sparse_value=NUMBERS))]),
    }.items(),
    ids=lambda case: case[0],
)
def test_every_way_by_which_a_sparse_tensor_comes_into_a_network_is_seen(data):
    assert is_sparse(data[1])
    assert not uses_text(data[1])


def test_what_is_dense_is_not_taken_for_sparse():
    assert not is_sparse(model(node("Constant", value=LABEL), initializer=[helper.make_tensor("w", FLOAT, [1], [0.0])]))


def test_a_type_is_the_last_32_bits_of_its_number_as_protobuf_reads_it():
    data = model(node(), initializer=[helper.make_tensor("w", TensorProto.INT16, [1], [3])])
    written = bytes([0x10, TensorProto.INT16])
    assert data.count(written) == 1
    odd = bytes([0x10, 0x88, 0x80, 0x80, 0x80, 0x10])  # 8 + 2^32
    graph = onnx.load_from_string(data).graph.initializer[0].SerializeToString()
    message = graph.replace(written, odd)
    assert TensorProto.FromString(message).data_type == TEXT
    assert uses_text(_field(7, _field(5, message)))
    tag = bytes(
        [0x90, 0x80, 0x80, 0x80, 0x10]
    )  # field 2, an integer, + 2^32: that of C++ reads it so, Python's does not
    assert uses_text(_field(7, _field(5, tag + bytes([TEXT]))))


def _field(number, content):
    return bytes([number << 3 | 2, len(content)]) + content


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (b"\x3a\x05ab", "ends behind"),
        (b"\x08" + b"\x80" * 30, "does not end"),
        (b"\x3b", "way 3"),
        (_field(7, b"\x0b"), "way 3"),
        (b"\x39abc", "ends behind"),
    ],
)
def test_what_is_no_message_is_told(data, told):
    with pytest.raises(ValueError, match=told):
        uses_text(data)


def test_messages_within_one_another_are_followed_as_deep_as_protobuf_does():
    data = node("Cast", to=TEXT).SerializeToString()
    for _ in range(40):  # a graph in an attribute of a node
        data = b"\x2a" + _sized(b"\x32" + _sized(b"\x0a" + _sized(data)))
    with pytest.raises(ValueError, match="more than 100"):
        uses_text(b"\x3a" + _sized(b"\x0a" + _sized(data)))


def _sized(content):
    size = len(content)
    return bytes([size % 128 + 128, size // 128]) + content


def test_the_fields_are_all_of_those_that_onnx_has():
    """Every field of its messages by which a tensor, a type or an attribute is reached."""
    ours = {"model": ModelProto.DESCRIPTOR}
    for message in FIELDS:
        for number, inner in FIELDS[message].items():
            ours.setdefault(inner, ours[message].fields_by_number[number].message_type)
    assert {ours[message].fields_by_number[number].name for message, number in TYPE_FIELDS.items()} == {
        "data_type", "elem_type", "key_type",
    }  # fmt: skip
    for message, descriptor in ours.items():
        leading = {f.number for f in descriptor.fields if f.message_type and _leads(f.message_type, set())}
        assert leading == set(FIELDS[message]), message


def _leads(descriptor, seen):
    """Whether a message holds a type anywhere."""
    if descriptor.full_name in seen:
        return False
    seen.add(descriptor.full_name)
    typed = {"data_type", "elem_type", "key_type"} & {field.name for field in descriptor.fields}
    return bool(typed) or any(_leads(f.message_type, seen) for f in descriptor.fields if f.message_type)
