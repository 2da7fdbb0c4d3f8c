"""Fans of triangles in a glTF, written out as triangles: trimesh leaves them out without a word."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from .gltf_file import Gltf
from .gltf_tree import FAN

_UINT, _TRIANGLES = 5125, 4  # type of an accessor, mode of a primitive


def without_fans(gltf: Gltf) -> Gltf:
    """The document with the faces of every fan as triangles of their own; less than three vertices are no face.

    Raises:
        InputError: an array is damaged.
    """
    accessors, views = ([*gltf.tree.get(kind, [])] for kind in ("accessors", "bufferViews"))
    buffers, written = [*gltf.buffers], dict[tuple[Any, int], int]()

    def triangles(primitive: dict[str, Any]) -> dict[str, Any]:
        indices, count = primitive.get("indices"), gltf.entry("accessors", primitive["attributes"]["POSITION"])["count"]
        if (indices, count) not in written:
            around = np.arange(count) if indices is None else gltf.array(indices)[:, 0]
            if len(around) < 3:
                return primitive
            faces = np.stack([around[1:-1], around[2:], np.full(len(around) - 2, around[0])], axis=1)
            written[indices, count] = len(accessors)
            buffers.append(faces.astype("<u4").tobytes())
            about = {"bufferView": len(views), "componentType": _UINT, "count": faces.size, "type": "SCALAR"}
            accessors.append(about)
            views.append({"buffer": len(buffers) - 1, "byteLength": len(buffers[-1])})
        return {**primitive, "indices": written[indices, count], "mode": _TRIANGLES}

    meshes = [
        {**mesh, "primitives": [triangles(one) if one.get("mode") == FAN else one for one in mesh["primitives"]]}
        for mesh in gltf.tree["meshes"]
    ]
    tree = {**gltf.tree, "meshes": meshes, "accessors": accessors, "bufferViews": views}
    return replace(gltf, tree=tree, buffers=tuple(buffers)) if written else gltf
