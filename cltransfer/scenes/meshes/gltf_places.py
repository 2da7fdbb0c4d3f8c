"""Which texture coordinates of a glTF its materials show, and where in the texture these are."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from ...computer.array_type import Array
from ...errors import InputError
from .gltf_tree import entry
from .mesh import REPEATED, Wrap
from .numbers import is_number

GLOSSY = "KHR_materials_pbrSpecularGlossiness"
TRANSFORM = "KHR_texture_transform"
REPEAT = 10497
WRAPS: dict[int, Wrap] = {REPEAT: "repeat", 33071: "clamp", 33648: "mirror"}  # of a sampler


def with_shown_places(path: Path, tree: dict[str, Any]) -> dict[str, Any]:
    """The document with the texture coordinates that each primitive's material shows as its first ones.

    Raises:
        InputError: a material shows some that the primitive does not have.
    """
    meshes = [
        {**mesh, "primitives": [_with_shown(path, tree, one) for one in mesh["primitives"]]} for mesh in tree["meshes"]
    ]
    return {**tree, "meshes": meshes}


def transform_of(path: Path, material: dict[str, Any]) -> Array | None:
    """From texture coordinates to places in the texture of base colours, (2, 3), both from its top left corner.

    None where they are the same.

    Raises:
        InputError: it is not made of numbers.
    """
    about = shown_texture(material).get("extensions", {}).get(TRANSFORM)
    if about is None:
        return None
    offset, scale, turn = about.get("offset", [0, 0]), about.get("scale", [1, 1]), about.get("rotation", 0)
    values = [*offset, *scale, turn]
    if len(offset) != 2 or len(scale) != 2 or not all(map(is_number, values)):
        raise InputError(path, TRANSFORM, f"expected five finite numbers, got {values!r:.80}")
    cos, sin = math.cos(turn), math.sin(turn)  # counter-clockwise as seen: the second axis points down
    linear = np.array([[cos, sin], [-sin, cos]]) * np.array(scale, np.float64)
    return np.column_stack([linear, np.array(offset, np.float64)])


def wraps_of(path: Path, tree: dict[str, Any], material: dict[str, Any]) -> tuple[Wrap, Wrap]:
    """How the texture of a material's base colours goes on beyond its edges, across and down.

    Raises:
        InputError: its sampler says what glTF does not know.
    """
    shown = shown_texture(material)
    index = entry(path, tree, "textures", shown["index"]).get("sampler") if shown else None
    if index is None:
        return REPEATED
    sampler = entry(path, tree, "samplers", index)
    across, down = (_wrap(path, f"samplers[{index}]", name, sampler) for name in ("wrapS", "wrapT"))
    return across, down


def _wrap(path: Path, field: str, name: str, sampler: dict[str, Any]) -> Wrap:
    stored = sampler.get(name, REPEAT)
    if stored not in WRAPS:
        known = ", ".join(f"{number} ({wrap})" for number, wrap in WRAPS.items())
        raise InputError(path, field, f"expected a {name} of {known}, got {stored!r:.40}")
    return WRAPS[stored]


def shown_texture(material: dict[str, Any]) -> dict[str, Any]:
    """What a material says of the texture of its base colours; empty where it has none."""
    glossy = material.get("extensions", {}).get(GLOSSY, {})
    plain = material.get("pbrMetallicRoughness", {}).get("baseColorTexture", {})
    found: dict[str, Any] = glossy.get("diffuseTexture", plain)
    return found


def _with_shown(path: Path, tree: dict[str, Any], primitive: dict[str, Any]) -> dict[str, Any]:
    if "material" not in primitive:
        return primitive
    about = shown_texture(entry(path, tree, "materials", primitive["material"]))
    transform = about.get("extensions", {}).get(TRANSFORM, {})
    name = f"TEXCOORD_{transform.get('texCoord', about.get('texCoord', 0))}"
    if name == "TEXCOORD_0":
        return primitive
    attributes = primitive["attributes"]
    if name not in attributes:
        raise InputError(path, name[:40], "is shown by a material of a mesh that has none")
    return {**primitive, "attributes": {**attributes, "TEXCOORD_0": attributes[name]}}
