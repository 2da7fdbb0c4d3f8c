"""glTF 2.0 files: the JSON, the buffers it names and the arrays in them. Every count is checked before it is used."""

from __future__ import annotations

import base64
import binascii
import json
import struct
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...computer.array_type import Array
from ...computer.memory import require_free
from ...errors import InputError
from .asset_files import Beside, read_limited
from .glass import GLASS
from .glow import STRENGTH, UNLIT, with_glow
from .gltf_places import GLOSSY, TRANSFORM, with_shown_places
from .gltf_tree import COUNT_LIMIT, TYPES, WIDTH, check_need, check_text, entry

NODE_LIMIT = 100_000
ZERO_BYTES = 8  # of a number that a sparse array does not store
DATA = "data:"
EXTENSIONS = {UNLIT, STRENGTH, "EXT_texture_webp", TRANSFORM, GLOSSY, GLASS}  # that are read
COMPRESSIONS = {
    "KHR_draco_mesh_compression",
    "KHR_mesh_quantization",
    "EXT_meshopt_compression",
    "KHR_meshopt_compression",
}

INSTANCES = "EXT_mesh_gpu_instancing"  # which a file may name as one that can be done without: a forest of one tree

_JSON, _BIN = 0x4E4F534A, 0x004E4942  # chunk types


@dataclass(frozen=True, eq=False)
class Gltf:
    """A glTF document.

    Args:
        path: where it was read from, for error lines.
        tree: its JSON.
        buffers: the bytes of each of its buffers.
    """

    path: Path
    tree: dict[str, Any]
    buffers: tuple[bytes | memoryview, ...]

    def entry(self, kind: str, index: Any) -> dict[str, Any]:
        """Entry ``index`` of the list ``kind``.

        Raises:
            InputError: there is none.
        """
        return entry(self.path, self.tree, kind, index)

    def view(self, index: Any) -> memoryview:
        """Bytes of a buffer view.

        Raises:
            InputError: there is none, or it names no buffer.
        """
        about = self.entry("bufferViews", index)
        if not 0 <= about.get("buffer", -1) < len(self.buffers):
            raise InputError(self.path, f"bufferViews[{index}]", "names no buffer")
        return memoryview(self.buffers[about["buffer"]])[about.get("byteOffset", 0) :][: about.get("byteLength", 0)]

    def array(self, accessor: Any) -> Array:
        """Rows of an accessor, (count, width), as stored; normalised integers become numbers in [-1, 1].

        One that names no buffer view is 0 everywhere, as a target that moves nothing (glTF 2.0, 3.6.2.1).

        Raises:
            InputError: it reaches beyond its buffer, or is of an unknown type.
            ResourceError: its buffer does not hold every row, and they take more memory than is free.
        """
        about, field = self.entry("accessors", accessor), f"accessors[{accessor}]"
        if "sparse" in about:
            return self._sparse(field, about)
        if "bufferView" in about:
            return self._dense(field, about)
        kind, width = self._row(field, about)
        return self._zeros(field, about, width, kind)

    def _sparse(self, field: str, about: dict[str, Any]) -> Array:
        """Rows of an accessor of which few are not what its buffer view says, or not 0 where it has none."""
        sparse, plain = about["sparse"], {key: value for key, value in about.items() if key != "sparse"}
        few = {**plain, "count": sparse["count"]}
        chosen = self._dense(
            f"{field}.indices", {**few, "type": "SCALAR", "byteOffset": 0, "normalized": False, **sparse["indices"]}
        )
        values = self._dense(f"{field}.values", {**few, "byteOffset": 0, **sparse["values"]})
        rows = self._dense(field, plain) if "bufferView" in about else self._zeros(field, about, values.shape[1])
        if chosen.dtype.kind != "u" or chosen.max() >= len(rows):
            raise InputError(self.path, f"{field}.indices", f"name row {chosen.max()} of {len(rows)}")
        rows[chosen[:, 0]] = values
        return rows

    def _zeros(self, field: str, about: dict[str, Any], width: int, kind: str = "<f8") -> Array:
        rows = about["count"]  # which nothing in the file holds
        require_free(ZERO_BYTES * rows * width, self.path, f"{rows} rows of {field}", "thin the file")
        return np.zeros((rows, width), kind)

    def _dense(self, field: str, about: dict[str, Any]) -> Array:
        count, offset = about.get("count", 0), about.get("byteOffset", 0)
        kind, width = self._row(field, about)
        data, view = self.view(about.get("bufferView")), self.entry("bufferViews", about["bufferView"])
        row = np.dtype(kind).itemsize * width
        stride = view.get("byteStride", row)
        if offset < 0 or stride < row or count < 1 or offset + (count - 1) * stride + row > len(data):
            raise InputError(self.path, field, f"{count} rows do not fit in its {len(data)} bytes")
        rows = np.ndarray((count, width), kind, data, offset, (stride, np.dtype(kind).itemsize))
        if about.get("normalized"):
            return np.maximum(rows.astype(np.float64) / np.iinfo(kind).max, -1.0)
        return rows.copy()

    def _row(self, field: str, about: dict[str, Any]) -> tuple[str, int]:
        """Type of the numbers of a row and how many they are."""
        kind, width = TYPES.get(about.get("componentType", 0)), WIDTH.get(about.get("type", ""), 0)
        if kind is None or not width:
            raise InputError(self.path, field, "expected plain numbers of a known type")
        return kind, width

    def to_glb(self) -> bytes:
        """As one binary file; images that are files of their own stay so."""
        starts, pieces, size = [], [], 0
        for data in self.buffers:
            starts.append(size)
            pieces += [data, b"\0" * (-len(data) % 4)]
            size += len(data) + len(pieces[-1])
        views = []
        for view in self.tree.get("bufferViews", []):
            first = starts[view["buffer"]] + view.get("byteOffset", 0)
            views.append({**view, "buffer": 0, "byteOffset": first})
        text = json.dumps({**self.tree, "bufferViews": views, "buffers": [{"byteLength": size}]}).encode()
        text += b" " * (-len(text) % 4)
        head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + size)
        parts = (struct.pack("<II", len(text), _JSON), text, struct.pack("<II", size, _BIN))
        return b"".join([head, *parts, *pieces])


def read_gltf(path: Path, files: Beside) -> Gltf:
    """A ``.glb`` or ``.gltf`` file, told apart by content, with its buffers.

    Raises:
        InputError: it is missing, empty, cut off or no glTF 2.0, needs an extension, asks for more than the limits,
            or names a file outside its folder.
    """
    data = read_limited(path)
    text, binary = _chunks(path, data) if data[:4] == b"glTF" else (data, None)
    check_text(path, text)
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(path, "", f"expected glTF: {error}") from None
    if not isinstance(tree, dict) or not str(tree.get("asset", {}).get("version", "")).startswith("2."):
        raise InputError(path, "asset", "expected glTF of version 2")
    if needed := set(tree.get("extensionsRequired", [])) - EXTENSIONS:
        hint = "export it without compression" if needed & COMPRESSIONS else ""
        raise InputError(path, "extensionsRequired", f"{', '.join(sorted(needed))} is not read", hint)
    if not tree.get("meshes"):
        raise InputError(path, "meshes", "holds no mesh")
    _check_limits(path, tree)
    tree = with_shown_places(path, with_glow(path, _with_scene(tree)))
    check_need(path, tree)
    buffers = tuple(_buffer(path, i, about, binary, files) for i, about in enumerate(tree.get("buffers", [])))
    for about in tree.get("images", []):
        uri = about.get("uri", DATA)
        if not uri.startswith(DATA):
            files.find(uri)  # refused here rather than drawn without it
    return Gltf(path, tree, buffers)


def _chunks(path: Path, data: bytes) -> tuple[bytes, bytes | None]:
    """JSON and binary chunk of a GLB."""
    if len(data) < 20:
        raise InputError(path, "header", "cut off")
    _, version, length = struct.unpack_from("<4sII", data)
    if version != 2:
        raise InputError(path, "header", f"expected glTF of version 2, got {version}")
    if length > len(data):
        raise InputError(path, "header", f"cut off: expected {length} bytes, got {len(data)}")
    chunks: dict[int, bytes] = {}
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<II", data, at)
        if at + 8 + size > length:
            raise InputError(path, "chunk", f"cut off: expected {size} bytes, got {length - at - 8}")
        chunks.setdefault(kind, data[at + 8 : at + 8 + size])
        at += 8 + size
    if _JSON not in chunks:
        raise InputError(path, "chunk", "holds no JSON")
    return chunks[_JSON], chunks.get(_BIN)


def _check_limits(path: Path, tree: dict[str, Any]) -> None:
    for kind in ("nodes", "meshes", "accessors", "bufferViews", "buffers", "images", "materials", "skins"):
        entries = tree.get(kind, [])
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise InputError(path, kind, "expected a list of objects")
        if len(entries) > NODE_LIMIT:
            raise InputError(path, kind, f"expected at most {NODE_LIMIT}, got {len(entries)}")
    if any(INSTANCES in (node.get("extensions") or {}) for node in tree.get("nodes", [])):
        raise InputError(path, "nodes", f"{INSTANCES} is not read", "export every instance as a node")
    for index, about in enumerate(tree.get("accessors", [])):
        count = about.get("count", 0)
        if not isinstance(count, int) or not 0 < count <= COUNT_LIMIT:
            raise InputError(path, f"accessors[{index}]", f"expected 1 to {COUNT_LIMIT} rows, got {count!r}")
    for kind in ("bufferViews", "accessors"):
        for index, about in enumerate(tree.get(kind, [])):
            offset = about.get("byteOffset", 0)
            if not isinstance(offset, int) or offset < 0:
                raise InputError(path, f"{kind}[{index}]", f"expected a byteOffset of 0 or more, got {offset!r:.40}")
    for index, about in enumerate(tree.get("skins", [])):
        _check_joints(path, f"skins[{index}].joints", about.get("joints", []), len(tree.get("nodes", [])))


def _check_joints(path: Path, field: str, joints: Any, nodes: int) -> None:
    if not isinstance(joints, list) or len(joints) > nodes:
        got = len(joints) if isinstance(joints, list) else type(joints).__name__
        raise InputError(path, field, f"expected a list of at most {nodes} nodes, as many as there are, got {got}")
    for joint, times in Counter(joints).most_common(1):
        if times > 1:
            raise InputError(path, field, f"expected each node once, {joint!r:.40} is there {times} times")


def _with_scene(tree: dict[str, Any]) -> dict[str, Any]:
    """The document with a scene: where it has none, of all nodes that hang from no other."""
    if tree.get("scenes"):
        return tree
    nodes = tree.get("nodes", [])
    below = {child for node in nodes for child in node.get("children", [])}
    return {**tree, "scene": 0, "scenes": [{"nodes": [i for i in range(len(nodes)) if i not in below]}]}


def _buffer(path: Path, index: int, about: dict[str, Any], binary: bytes | None, files: Beside) -> memoryview:
    """Bytes of one buffer: the binary chunk, a data URI or a file beside, as long as it is to be."""
    uri, length, field = about.get("uri"), about["byteLength"], f"buffers[{index}]"
    data = (binary or b"") if uri is None else uri_bytes(path, field, uri, files)
    if len(data) < length:
        raise InputError(path, field, f"cut off: expected {length} bytes, got {len(data)}")
    return memoryview(data)[:length]


def uri_bytes(path: Path, field: str, uri: str, files: Beside) -> bytes:
    """Bytes that ``uri`` holds, or those of the file that it names.

    Raises:
        InputError: it holds no base64, or names a file that is not there or outside the folder.
    """
    if not uri.startswith(DATA):
        return files.get(uri)
    try:
        return base64.b64decode(uri.partition(",")[2], validate=True)
    except binascii.Error:
        raise InputError(path, field, "expected base64 data") from None
