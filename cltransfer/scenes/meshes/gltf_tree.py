"""What the JSON of a glTF asks for: which arrays its meshes are made of, and how much memory they take once built.

A few bytes of it name the same array, node or file many times, so all is summed before any of it is made.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ...computer.memory import require_free
from ...errors import InputError
from .asset_files import LIMIT

COUNT_LIMIT = 20_000_000  # rows of one array, vertices and faces of one scene
PART_LIMIT = 100_000  # meshes placed, each primitive for itself
STRIP, FAN = 5, 6  # modes of a primitive that give a face for each index
READ = ("POSITION", "TEXCOORD_0", "COLOR_0")  # attributes of a vertex

TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}

_MOST_JSON = {b"{": 250, b"[": 64, b",": 60}  # bytes that Python takes at most for what begins there
_NOTHING = {"componentType": 5121, "type": "SCALAR", "count": 1}  # an array that nobody reads
_COPIES = 4  # of the buffers, from the file to trimesh's arrays
_PART_BYTES, _VERTEX_BYTES, _FACE_BYTES = 15_000, 200, 100  # of what is built, at the peak
_SKIN_BYTES = 1600  # of a vertex while its mesh is posed
_JOINT_BYTES = 5000  # of a joint, most of them the words of its name


def check_need(path: Path, tree: dict[str, Any]) -> None:
    """Hold what the meshes of a document take against limits and against the memory there is.

    Raises:
        InputError: it is more than the limits, or an array is stored in a way that is not read.
        ResourceError: it is more than is free.
    """
    sizes, built = _stored(path, tree), _built(tree)
    for kind, size in sizes.items():
        if size > LIMIT:
            raise InputError(path, kind, f"expected at most {LIMIT} bytes in all, got {size}")
    for name, limit in (("parts", PART_LIMIT), ("vertices", COUNT_LIMIT), ("faces", COUNT_LIMIT)):
        if built[name] > limit:
            raise InputError(path, "nodes", f"expected at most {limit} {name} in all, got {built[name]}")
    need = _PART_BYTES * built["parts"] + _VERTEX_BYTES * built["vertices"] + _FACE_BYTES * built["faces"]
    need += _JOINT_BYTES * sum(len(skin.get("joints", [])) for skin in tree.get("skins", []))
    need += _SKIN_BYTES * built["posed"] + _COPIES * sizes["buffers"] + sizes["bufferViews"] + sizes["accessors"]
    require_free(need, path, f"meshes of {built['vertices']} vertices", "thin the file")


def entry(path: Path, tree: dict[str, Any], kind: str, index: Any) -> dict[str, Any]:
    """Entry ``index`` of the list ``kind``.

    Raises:
        InputError: there is none.
    """
    entries = tree.get(kind, [])
    if not isinstance(index, int) or not 0 <= index < len(entries):
        raise InputError(path, kind, f"has no entry {index!r}")
    found: dict[str, Any] = entries[index]
    return found


def check_text(path: Path, text: bytes) -> None:
    """Hold what a JSON takes once parsed against the memory there is.

    Raises:
        ResourceError: it is more than is free.
    """
    need = 2 * len(text) + sum(size * text.count(mark) for mark, size in _MOST_JSON.items())
    require_free(need, path, "entries of its JSON", "thin the file")


def used_accessors(tree: dict[str, Any]) -> list[Any]:
    """Accessors that the meshes of a document are made of, each once."""
    primitives = [primitive for mesh in tree.get("meshes", []) for primitive in mesh["primitives"]]
    return list(dict.fromkeys(index for primitive in primitives for index in _of_primitive(primitive)))


def lean(tree: dict[str, Any]) -> dict[str, Any]:
    """The document with nothing of its meshes but what is read: other arrays are not even made."""
    meshes = [{**mesh, "primitives": [_lean(one) for one in mesh["primitives"]]} for mesh in tree.get("meshes", [])]
    used = set(used_accessors(tree))
    accessors = [about if i in used else _NOTHING for i, about in enumerate(tree.get("accessors", []))]
    shown = {about["bufferView"] for about in accessors if "bufferView" in about}
    views = [
        about if i in shown else {"buffer": 0, "byteLength": 0} for i, about in enumerate(tree.get("bufferViews", []))
    ]
    return {**tree, "meshes": meshes, "accessors": accessors, "bufferViews": views}


def row_bytes(about: dict[str, Any]) -> int:
    """Bytes of a row of an accessor, 0 where its type is not known."""
    kind, width = TYPES.get(about.get("componentType", 0), ""), WIDTH.get(about.get("type", ""), 0)
    return int(kind[2:] or 0) * width


def _of_primitive(primitive: dict[str, Any]) -> Iterator[Any]:
    yield from (index for name, index in primitive["attributes"].items() if name in READ)
    if "indices" in primitive:
        yield primitive["indices"]


def _lean(primitive: dict[str, Any]) -> dict[str, Any]:
    attributes = {name: index for name, index in primitive["attributes"].items() if name in READ}
    return {
        **{name: primitive[name] for name in ("indices", "material", "mode") if name in primitive},
        "attributes": attributes,
    }


def _length(path: Path, field: str, about: dict[str, Any]) -> int:
    length = about.get("byteLength", 0)
    if not isinstance(length, int) or not 0 < length <= LIMIT:
        raise InputError(path, field, f"expected 1 to {LIMIT} bytes, got {length!r:.40}")
    return length


def _stored(path: Path, tree: dict[str, Any]) -> dict[str, int]:
    """Bytes of all buffers, and of the views and arrays that meshes are made of."""
    arrays = []
    for index in used_accessors(tree):
        about = entry(path, tree, "accessors", index)
        if not row_bytes(about) or "sparse" in about or "bufferView" not in about:
            raise InputError(path, f"accessors[{index}]", "expected plain numbers in a buffer view")
        arrays.append(about)
    views = {index: entry(path, tree, "bufferViews", index) for index in dict.fromkeys(a["bufferView"] for a in arrays)}
    return {
        "buffers": sum(_length(path, f"buffers[{i}]", about) for i, about in enumerate(tree.get("buffers", []))),
        "bufferViews": sum(_length(path, f"bufferViews[{i}]", about) for i, about in views.items()),
        "accessors": sum(about["count"] * row_bytes(about) for about in arrays),
    }


def _built(tree: dict[str, Any]) -> Counter[str]:
    """Parts, vertices and faces of all meshes as often as they are placed, and vertices of the largest posed one."""
    times, skinned = _placed(tree)
    built: Counter[str] = Counter()
    for index, mesh in enumerate(tree.get("meshes", [])):
        copies = max(1, times[index])  # trimesh makes what is not placed too
        for primitive in mesh["primitives"]:
            vertices = tree["accessors"][primitive["attributes"]["POSITION"]]["count"]
            indices = tree["accessors"][primitive["indices"]]["count"] if "indices" in primitive else vertices
            faces = indices if primitive.get("mode") in (STRIP, FAN) else indices // 3
            built.update(parts=copies, vertices=copies * vertices, faces=copies * faces)
            built["posed"] = max(built["posed"], vertices if index in skinned else 0)
    return built


def _placed(tree: dict[str, Any]) -> tuple[Counter[int], set[int]]:
    """How often each mesh is placed, and which are posed: those are placed wherever their node is."""
    nodes, scenes = tree.get("nodes", []), tree.get("scenes", [])
    roots = [scenes[tree.get("scene", 0)].get("nodes", [])] if scenes else []
    below = Counter(index for one in [*roots, *(node.get("children", []) for node in nodes)] for index in set(one))
    times: Counter[int] = Counter()
    for index, node in enumerate(nodes):
        if "mesh" in node:
            times[node["mesh"]] += 1 if "skin" in node else below[index]
    return times, {node["mesh"] for node in nodes if "mesh" in node and "skin" in node}
