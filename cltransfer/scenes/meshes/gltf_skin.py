"""Skinned glTF frozen at one time: what comes out is a glTF of the same look without skins, and the skeleton.

trimesh reads meshes, not skins; so the pose is written into the vertices before it sees the file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from kornia.geometry.conversions import quaternion_to_rotation_matrix

from ...computer.array_type import Array
from ...errors import InputError
from .gltf_animation import REST, channels
from .gltf_figure import Skeleton, held_by, parents_of, skeleton_of, skins_of_figure
from .gltf_file import Gltf
from .gltf_morph import morphed

POSED = "cltransfer posed"  # start of the names of nodes with a mesh of the figure with the skeleton
OTHER = "another figure"


def posed(gltf: Gltf, time: float, animation: str | None = None) -> tuple[Gltf, Skeleton | None]:
    """The document at ``time`` [s] of an animation, its first one if none is named; and the first figure's skeleton.

    Times before the start and after the end hold the first and last pose.

    Raises:
        InputError: there is no such animation, or none at all and the time is not 0; nodes form a circle; an array is
            damaged.
    """
    animated = channels(gltf, time, animation)
    gltf, local = morphed(gltf, animated), _local(gltf, animated)
    world = _world(gltf, local)
    drawn = [i for i in _shown(gltf) if "mesh" in gltf.tree["nodes"][i]]
    skins = {i: node["skin"] for i in drawn if "skin" in (node := gltf.tree["nodes"][i])}
    matrices = {skin: _joint_matrices(gltf, gltf.entry("skins", skin), world) for skin in dict.fromkeys(skins.values())}
    figure = skins_of_figure(gltf, [*matrices])
    names = {node: f"{POSED if skin in figure else OTHER} {node}" for node, skin in skins.items()}
    held = held_by(gltf, figure, [i for i in drawn if i not in skins])
    still = _with_matrices(gltf, local, {node: f"{POSED} {node}" for node in held})
    frozen, parts = _frozen(still, gltf, names, matrices)
    own = {skin: moved for skin, moved in parts.items() if skin in figure}
    if not own:
        return frozen, None
    turned = np.concatenate([np.linalg.det(matrices[skin][:, :3, :3]) for skin in own])
    return frozen, skeleton_of(gltf, world, own, bool(np.median(turned) < 0))


def _shown(gltf: Gltf) -> list[int]:
    """Nodes of the scene that is shown, in the order of the document."""
    scenes = gltf.tree.get("scenes", [])
    left, found = [*gltf.entry("scenes", gltf.tree.get("scene", 0)).get("nodes", [])] if scenes else [], set[int]()
    while left:
        node = left.pop()
        if node not in found:
            found.add(node)
            left += gltf.entry("nodes", node).get("children", [])
    return sorted(found)


def _local(gltf: Gltf, animated: dict[tuple[int, str], Array]) -> list[Array]:
    """Each node's transform to its parent, (4, 4)."""
    matrices = []
    for i, node in enumerate(gltf.tree.get("nodes", [])):
        if "matrix" in node and not any((i, path) in animated for path in REST):
            matrices.append(np.array(node["matrix"], np.float64).reshape(4, 4).T)
            continue
        move, turn, scale = (np.array(animated.get((i, p), node.get(p, rest)), float) for p, rest in REST.items())
        matrix = np.eye(4)
        rotation = quaternion_to_rotation_matrix(torch.from_numpy(turn[[3, 0, 1, 2]]))
        matrix[:3, :3] = rotation.numpy() * scale
        matrix[:3, 3] = move
        matrices.append(matrix)
    return matrices


def _world(gltf: Gltf, local: list[Array]) -> list[Array]:
    """Each node's transform to the world, (4, 4)."""
    parents = parents_of(gltf)
    world: dict[int, Array] = {}
    for node in range(len(local)):
        way = [node]
        while way[-1] in parents and way[-1] not in world:
            way.append(parents[way[-1]])
            if len(way) > len(local):
                raise InputError(gltf.path, "nodes", f"node {node} is its own parent")
        for one in reversed(way):
            if one not in world:
                above = parents.get(one)
                world[one] = local[one] if above is None else world[above] @ local[one]
    return [world[i] for i in range(len(local))]


def _with_matrices(gltf: Gltf, local: list[Array], names: Mapping[int, str]) -> Gltf:
    """The same document with the pose of every node written down, no animation and no camera, and some other names.

    trimesh puts no node that has a camera into its scene, and so nothing that hangs from one.
    """
    nodes = []
    for i, (node, matrix) in enumerate(zip(gltf.tree.get("nodes", []), local)):
        kept = {key: value for key, value in node.items() if key not in (*REST, "camera", "skin")}
        named = {"name": names[i]} if i in names else {}
        nodes.append({**kept, **named, "matrix": matrix.T.ravel().tolist()})
    tree = {key: value for key, value in gltf.tree.items() if key not in ("animations", "skins")}
    return replace(gltf, tree={**tree, "nodes": nodes})


def _frozen(
    still: Gltf, source: Gltf, names: Mapping[int, str], matrices: Mapping[int, Array]
) -> tuple[Gltf, dict[int, list[tuple[Array, Array]]]]:
    """``still`` with the skinned meshes of some nodes posed in the world; vertices and strongest joint of their parts.

    Args:
        still: the document without skins.
        source: the document.
        names: of the new nodes, by the node whose mesh they have.
        matrices: of the joints of each skin, which the parts are told by too.
    """
    kinds = ("nodes", "meshes", "accessors", "bufferViews")
    nodes, meshes, accessors, views = ([*still.tree.get(kind, [])] for kind in kinds)
    buffers, first, parts = [*still.buffers], len(nodes), dict[int, list[tuple[Array, Array]]]()
    for node, name in names.items():
        about, primitives = source.tree["nodes"][node], []
        mesh, skin = source.entry("meshes", about["mesh"]), about["skin"]
        for primitive in mesh["primitives"]:
            vertices, strongest = _skinned(source, primitive["attributes"], matrices[skin])
            kept = {k: v for k, v in primitive["attributes"].items() if k.startswith(("TEXCOORD", "COLOR"))}
            primitives.append({**primitive, "attributes": {**kept, "POSITION": len(accessors)}, "targets": []})
            accessors.append({"bufferView": len(views), "componentType": 5126, "count": len(vertices), "type": "VEC3"})
            buffers.append(vertices.astype("<f4").tobytes())
            views.append({"buffer": len(buffers) - 1, "byteLength": len(buffers[-1])})
            parts.setdefault(skin, []).append((vertices, strongest))
        nodes.append({"name": name, "mesh": len(meshes)})
        nodes[node] = {key: value for key, value in nodes[node].items() if key not in ("mesh", "skin")}
        meshes.append({**mesh, "primitives": primitives})
    placed = range(first, len(nodes))
    scenes = [{**scene, "nodes": [*scene.get("nodes", []), *placed]} for scene in still.tree.get("scenes", [])]
    lists = zip((*kinds, "scenes"), (nodes, meshes, accessors, views, scenes))
    return replace(still, tree={**still.tree, **dict(lists)}, buffers=tuple(buffers)), parts


def _joint_matrices(gltf: Gltf, skin: dict[str, Any], world: list[Array]) -> Array:
    """From the mesh as it was bound to the posed world, (J, 4, 4)."""
    joints = skin["joints"]
    for joint in joints:
        gltf.entry("nodes", joint)
    bound = np.broadcast_to(np.eye(4), (len(joints), 4, 4))
    if "inverseBindMatrices" in skin:
        stored = gltf.array(skin["inverseBindMatrices"])
        if stored.shape[1] != 16 or len(stored) < len(joints):
            got = f"{len(stored)} of {stored.shape[1]} numbers"
            raise InputError(gltf.path, "skins", f"expected {len(joints)} inverse bind matrices or more, got {got}")
        bound = stored[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1).astype(np.float64)
    return np.asarray(np.stack([world[joint] for joint in joints]) @ bound)


def _skinned(gltf: Gltf, attributes: dict[str, int], matrices: Array) -> tuple[Array, Array]:
    """Posed vertices (V, 3) and the joint that moves each most (V,): linear blend skinning."""
    if not {"POSITION", "JOINTS_0", "WEIGHTS_0"} <= attributes.keys():
        raise InputError(gltf.path, "skins", "a skinned mesh has no POSITION, JOINTS_0 or WEIGHTS_0")
    rest = gltf.array(attributes["POSITION"]).astype(np.float64)
    if "JOINTS_2" in attributes:
        raise InputError(gltf.path, "skins", "expected at most 8 joints a vertex, got JOINTS_2", "limit them to 4 or 8")
    sets = [k for k in range(2) if f"JOINTS_{k}" in attributes]
    joints, weights = (
        np.concatenate([gltf.array(attributes[f"{kind}_{k}"]) for k in sets], axis=1) for kind in ("JOINTS", "WEIGHTS")
    )
    if len(joints) != len(rest) or joints.shape != weights.shape or rest.shape[1] != 3:
        raise InputError(gltf.path, "skins", f"{len(rest)} vertices have {len(joints)} joints, {len(weights)} weights")
    wrong = joints[(joints < 0) | (joints >= len(matrices))]
    if len(wrong):
        raise InputError(gltf.path, "skins", f"joint {wrong[0]} of {len(matrices)}")
    total = weights.sum(1, keepdims=True)
    share = np.where(total > 0, weights, np.eye(1, weights.shape[1])) / np.where(total > 0, total, 1)  # else the first
    blended = np.einsum("vk,vkij->vij", share, matrices[joints])
    vertices = np.einsum("vij,vj->vi", blended[:, :3, :3], rest) + blended[:, :3, 3]
    return vertices, np.take_along_axis(joints, weights.argmax(1)[:, None], axis=1)[:, 0]
