"""The figure of a skinned glTF: which skins it is made of, as of a body, clothes and hair, and their joints as one."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass

import numpy as np

from ...computer.array_type import Array
from .gltf_file import Gltf


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Joints of a posed figure.

    Args:
        names: of the joints.
        parents: the joint above each, -1 for none.
        points: where the joints are, (J, 3), scene units.
        vertices: of all its skinned meshes, posed, (V, 3).
        strongest: the joint that moves each vertex most, (V,).
        mirrored: whether the figure is seen as in a mirror, so that its left arm is a right one.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    points: Array  # (J, 3)
    vertices: Array  # (V, 3)
    strongest: Array  # (V,)
    mirrored: bool = False


def skins_of_figure(gltf: Gltf, skins: Sequence[int]) -> set[int]:
    """Those of ``skins`` that hang from a joint that the first one hangs from, or another of them does."""
    joints = {skin: gltf.entry("skins", skin)["joints"] for skin in skins}
    known = {joint for one in joints.values() for joint in one}
    top = _outermost(gltf, known, known)
    tops = {skin: {top[joint] for joint in one} for skin, one in joints.items()}
    below: dict[int | None, list[int]] = defaultdict(list)
    for skin, one in tops.items():
        for node in one:
            below[node].append(skin)
    found, left = set[int](), [*skins[:1]]
    while left:
        skin = left.pop()
        found.add(skin)
        left += [other for node in tops[skin] for other in below.pop(node, [])]
    return found


def held_by(gltf: Gltf, skins: Iterable[int], nodes: Sequence[int]) -> list[int]:
    """Those of ``nodes`` that are a joint of ``skins`` or hang from one: a hat, glasses, what a hand holds."""
    joints = {joint for skin in skins for joint in gltf.entry("skins", skin)["joints"]}
    top = _outermost(gltf, nodes, joints)
    return [node for node in nodes if top[node] is not None]


def skeleton_of(
    gltf: Gltf, world: Sequence[Array], parts: Mapping[int, Sequence[tuple[Array, Array]]], mirrored: bool
) -> Skeleton:
    """The joints of a figure, in the same order whichever of its meshes comes first.

    Args:
        gltf: the document.
        world: each node's transform to the world, (4, 4).
        parts: posed vertices (V, 3) and the strongest joint of each (V,), counted within its skin, of the meshes by
            skin.
        mirrored: see :class:`Skeleton`.
    """
    joints = {skin: gltf.entry("skins", skin)["joints"] for skin in parts}
    skins = sorted(parts, key=lambda skin: (-len(joints[skin]), joints[skin]))
    above, nodes = parents_of(gltf), list(dict.fromkeys(node for skin in skins for node in joints[skin]))
    place = {node: i for i, node in enumerate(nodes)}
    nearest = _downwards(above, nodes, lambda node, up: place.get(node, up))  # at a node or above it
    ups = [nearest[above[node]] if node in above else None for node in nodes]
    places = {skin: np.array([place[node] for node in joints[skin]]) for skin in skins}
    moved = [(vertices, places[skin][strongest]) for skin in skins for vertices, strongest in parts[skin]]
    vertices, strongest = (np.concatenate(column) for column in zip(*moved))
    names = tuple(str(gltf.tree["nodes"][node].get("name", node)) for node in nodes)
    points = np.stack([world[node][:3, 3] for node in nodes])
    return Skeleton(names, tuple(-1 if up is None else up for up in ups), points, vertices, strongest, mirrored)


def parents_of(gltf: Gltf) -> dict[int, int]:
    """The node above each that hangs from one."""
    nodes = gltf.tree.get("nodes", [])
    return {child: i for i, node in enumerate(nodes) for child in node.get("children", [])}


def _outermost(gltf: Gltf, nodes: Iterable[int], known: Set[int]) -> dict[int, int | None]:
    """The outermost of ``known`` that each of ``nodes`` is or hangs from, None where there is none."""

    def outermost(node: int, outer: int | None) -> int | None:
        return node if outer is None and node in known else outer

    return _downwards(parents_of(gltf), nodes, outermost)


def _downwards(
    above: Mapping[int, int], nodes: Iterable[int], pick: Callable[[int, int | None], int | None]
) -> dict[int, int | None]:
    """What ``pick`` makes of each of ``nodes`` and of what it made of the node above, None above a root."""
    made: dict[int, int | None] = {}
    for node in nodes:
        way = [node]
        while way[-1] in above and way[-1] not in made:
            way.append(above[way[-1]])
        for one in reversed(way):
            if one not in made:
                made[one] = pick(one, made[above[one]] if one in above else None)
    return made
