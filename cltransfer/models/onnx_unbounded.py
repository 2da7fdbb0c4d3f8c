"""Whether an ONNX file uses what no arena bounds, text or sparse tensors: told by its fields, before it is loaded.

Sparse tensors are made dense outside of the arena while a network is loaded. Text comes into a network by a tensor or a
value that is declared as text, by an attribute that says "string" in its name (of a constant, of labels) or holds the
type (of a cast); every other operator on text needs some to begin with.
"""

from __future__ import annotations

from collections.abc import Iterator

FIELDS = {  # by message: the number of each field that leads to a type or an attribute, and the message it holds
    "model": {7: "graph", 20: "training", 25: "function"},
    "training": {1: "graph", 2: "graph"},
    "graph": {1: "node", 5: "tensor", 11: "value", 12: "value", 13: "value", 15: "sparse"},
    "function": {7: "node", 11: "attribute", 12: "value"},
    "node": {5: "attribute"},
    "attribute": {5: "tensor", 6: "graph", 10: "tensor", 11: "graph", 14: "type", 15: "type", 22: "sparse",
                  23: "sparse"},
    "tensor": {},
    "sparse": {1: "tensor", 2: "tensor"},
    "value": {2: "type"},
    "type": {1: "elements", 4: "sequence", 5: "map", 8: "elements", 9: "sequence"},
    "elements": {},
    "sequence": {1: "type"},
    "map": {2: "type"},
}  # fmt: skip
TYPE_FIELDS = {"tensor": 2, "elements": 1, "map": 1}  # the field that tells what the elements, or keys, are
STRING = 8  # as it tells it
NAME, INTEGER, STANDS_FOR = 1, 3, 21  # fields of an attribute; in a function it may stand for one of the function's
TYPES = {b"to", b"dtype"}  # attributes that hold a type: to cast to, of an empty sequence
VARINT, EIGHT_BYTES, BYTES, FOUR_BYTES = 0, 1, 2, 5  # how a field is written

DEEPEST = 100  # messages within one another, as protobuf reads them

Field = tuple[int, int | memoryview]


def uses_text(data: bytes) -> bool:
    """Whether a network may hold text at any point.

    Args:
        data: its file.

    Raises:
        ValueError: it is no protobuf message.
    """
    are_string: set[bytes] = set()  # names of attributes that are the integer STRING
    stand_for: dict[bytes, set[bytes]] = {}
    for message, content in _messages("model", memoryview(data)):
        if message in TYPE_FIELDS and _is_string(content, TYPE_FIELDS[message]):
            return True
        if message == "attribute":
            name, other = _text(content, NAME), _text(content, STANDS_FOR)
            if b"string" in name:
                return True
            if _is_string(content, INTEGER):
                are_string.add(name)
            if other:
                stand_for.setdefault(name, set()).add(other)
    types = TYPES
    while more := set().union(*(stand_for.get(name, set()) for name in types)) - types:
        types = types | more
    return not types.isdisjoint(are_string)


def is_sparse(data: bytes) -> bool:
    """Whether a network has a sparse tensor, as a weight or as a constant.

    Args:
        data: its file.

    Raises:
        ValueError: it is no protobuf message.
    """
    return any(message == "sparse" for message, _ in _messages("model", memoryview(data)))


def _messages(message: str, content: memoryview, depth: int = 0) -> Iterator[tuple[str, memoryview]]:
    """Every message in which a type or an attribute may stand, and its bytes."""
    if depth > DEEPEST:
        raise ValueError(f"more than {DEEPEST} messages within one another")
    yield message, content
    inner = FIELDS[message]
    for number, value in _fields(content) if inner else ():
        if number in inner and not isinstance(value, int):
            yield from _messages(inner[number], value, depth + 1)


def _fields(content: memoryview) -> Iterator[Field]:
    """Number and value of the fields that are integers, texts or messages."""
    at = 0
    while at < len(content):
        tag, at = _varint(content, at)
        number, kind = tag % 2**32 >> 3, tag % 8  # a reader keeps 32 bits
        if kind == VARINT:
            value, at = _varint(content, at)
            yield number, value
        elif kind == BYTES:
            size, begin = _varint(content, at)
            at = begin + size
            yield number, content[begin:at]
        elif kind in (EIGHT_BYTES, FOUR_BYTES):
            at += 8 if kind == EIGHT_BYTES else 4
        else:
            raise ValueError(f"a field is written in way {kind}")
    if at > len(content):
        raise ValueError("a field ends behind its message")


def _varint(content: memoryview, at: int) -> tuple[int, int]:
    """An integer of seven bits a byte, and where it ends."""
    value = 0
    for shift, byte in enumerate(content[at : at + 10]):
        value |= byte % 128 << 7 * shift
        if byte < 128:
            return value, at + shift + 1
    raise ValueError("an integer does not end")


def _is_string(content: memoryview, number: int) -> bool:
    return any(n == number and isinstance(v, int) and v % 2**32 == STRING for n, v in _fields(content))


def _text(content: memoryview, number: int) -> bytes:
    """The text in a field, empty where it is not there; of several the last, as protobuf has it."""
    found = b""
    for n, v in _fields(content):
        if n == number and not isinstance(v, int):
            found = bytes(v)
    return found
