"""Morph targets of a glTF: what a figure's build or face adds to its vertices, by weights.

trimesh reads meshes, not targets; so they are added to the vertices before it sees the file, and before a skin moves
them (glTF 2.0, 3.7.2.2).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...computer.array_type import Array
from ...computer.memory import require_free
from ...errors import InputError
from .gltf_animation import WEIGHTS
from .gltf_file import Gltf

Shape = tuple[int, tuple[float, ...]]  # a mesh, and the weights of its targets, none where all are 0

MOST_MOVED = 500_000_000  # vertices that targets move, summed over targets and meshes
VERTEX_BYTES = 300  # of a shape that is made, trimesh's copy with it


def morphed(gltf: Gltf, animated: Mapping[tuple[int, str], Array]) -> Gltf:
    """The document with the shapes that its weights give: those animated, of the node, or of the mesh.

    A mesh that nodes show in several shapes is there once for each.

    Args:
        gltf: a document.
        animated: values by node and property.

    Raises:
        InputError: there are not as many weights as targets, or a target is damaged or not as long as its mesh.
        ResourceError: the shapes take more memory than is free.
    """
    nodes, shapes = [*gltf.tree.get("nodes", [])], dict[Shape, int]()  # and where its mesh is now
    meshes, seen = [*gltf.tree["meshes"]], set[int]()
    for index, node in enumerate(nodes):
        if "mesh" not in node:
            continue
        mesh = gltf.entry("meshes", node["mesh"])
        weights = animated.get((index, WEIGHTS), node.get(WEIGHTS, mesh.get(WEIGHTS, ())))
        shape = _shape(gltf, node["mesh"], mesh, weights)
        if shape not in shapes:
            shapes[shape] = len(meshes) if node["mesh"] in seen else node["mesh"]
            meshes += [mesh] if node["mesh"] in seen else []
            seen.add(node["mesh"])
        nodes[index] = {**node, "mesh": shapes[shape]}
    _check_need(gltf, shapes)
    views, accessors = ([*gltf.tree.get(kind, [])] for kind in ("bufferViews", "accessors"))
    buffers = [*gltf.buffers]
    for (source, weights), place in shapes.items():
        primitives = []
        for primitive in meshes[place]["primitives"] if weights else ():
            vertices = _vertices(gltf, primitive, f"meshes[{source}]", weights)
            primitives.append({**primitive, "attributes": {**primitive["attributes"], "POSITION": len(accessors)}})
            accessors.append({"bufferView": len(views), "componentType": 5126, "count": len(vertices), "type": "VEC3"})
            buffers.append(vertices.astype("<f4").tobytes())
            views.append({"buffer": len(buffers) - 1, "byteLength": len(buffers[-1])})
        meshes[place] = {**meshes[place], "primitives": primitives} if primitives else meshes[place]
    new = {"nodes": nodes, "meshes": meshes, "accessors": accessors, "bufferViews": views}
    return replace(gltf, tree={**gltf.tree, **new}, buffers=tuple(buffers))


def _shape(gltf: Gltf, index: int, mesh: Mapping[str, Any], weights: Sequence[float] | Array) -> Shape:
    """Of a mesh under ``weights``, of which each of its primitives has a target."""
    if not any(weights):
        return index, ()
    for primitive in mesh["primitives"]:
        targets = primitive.get("targets", ())
        if len(targets) != len(weights):
            reason = f"has {len(targets)} targets and {len(weights)} weights"
            raise InputError(gltf.path, f"meshes[{index}]", reason)
    return index, tuple(map(float, weights))


def _check_need(gltf: Gltf, shapes: Iterable[Shape]) -> None:
    """Hold what the shapes take against what is free, and what their targets move against the limit."""
    made = moved = 0
    for mesh, weights in shapes:
        primitives = gltf.tree["meshes"][mesh]["primitives"] if weights else ()
        vertices = sum(gltf.entry("accessors", one["attributes"]["POSITION"])["count"] for one in primitives)
        made, moved = made + vertices, moved + vertices * sum(map(bool, weights))
    require_free(VERTEX_BYTES * made, gltf.path, f"shapes of {made} vertices", "thin the file")
    if moved > MOST_MOVED:
        raise InputError(gltf.path, "targets", f"move more than {MOST_MOVED} vertices", "thin the file")


def _vertices(gltf: Gltf, primitive: dict[str, Any], field: str, weights: Sequence[float]) -> Array:
    """Vertices of a primitive with its targets added, (V, 3)."""
    vertices = gltf.array(primitive["attributes"]["POSITION"]).astype(np.float64)
    for target, weight in zip(primitive["targets"], weights):
        if weight and "POSITION" in target:
            moves = gltf.array(target["POSITION"])
            if moves.shape != vertices.shape:
                raise InputError(gltf.path, field, f"a target moves {len(moves)} of {len(vertices)} vertices")
            vertices += weight * moves
    return vertices
