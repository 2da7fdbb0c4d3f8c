"""Materials that shine: what is black but for its light is drawn in the colour of that, and is lit by no other.

So programs export what is to look the same everywhere. To other colours no light is added, which is told.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from .gltf_places import GLOSSY
from .mtl_text import blocks, key_of, materials, said

UNLIT = "KHR_materials_unlit"
STRENGTH = "KHR_materials_emissive_strength"
GLOWS = "cltransfer_glows"  # a key beside those of an MTL, of a material whose colour is its light
WHOLE = "cltransfer_whole"  # a key beside those of a glTF, of a material whose image has no holes whatever its alpha is
_PASSED_OVER = "light is not read, what shines is drawn in its other colours alone"

_log = logging.getLogger("cltransfer")


def with_glow(path: Path, tree: dict[str, Any]) -> dict[str, Any]:
    """A glTF's JSON with the light of its black materials as base colours that no light changes.

    Raises:
        InputError: a light is not made of numbers.
    """
    used = {primitive.get("material") for mesh in tree["meshes"] for primitive in mesh["primitives"]}
    materials, solid, passed_over = [*tree.get("materials", [])], set(), []
    for index, about in enumerate(tree.get("materials", [])):
        light = _light(path, about)
        if light and _is_black(about):
            materials[index] = _glowing(about, light)
            solid |= {index} if _is_solid(about) else set()
        elif light and index in used:
            passed_over.append(str(about.get("name", index)))
    if passed_over:
        _log.warning("%s: emission of material %s: %s", path, named(passed_over), _PASSED_OVER)
    meshes = [{**mesh, "primitives": [_uncolored(one, solid) for one in mesh["primitives"]]} for mesh in tree["meshes"]]
    return {**tree, "materials": materials, "meshes": meshes} if materials else tree


def named(names: Sequence[str]) -> str:
    """The first of ``names`` and how many more there are, for a line."""
    return f"{names[0][:40]!r}{f' and {len(names) - 1} more' * (len(names) > 1)}"


def _light(path: Path, about: dict[str, Any]) -> list[float]:
    """Linear RGB that a material sends out, times its image, the largest at most 1; empty where it is dark."""
    extensions = about.get("extensions", {})
    stored = [about.get("emissiveFactor", [0, 0, 0]), extensions.get(STRENGTH, {}).get("emissiveStrength", 1)]
    factor, strength = (np.array(value, np.float64) for value in stored)
    if factor.shape != (3,) or strength.shape != () or not np.isfinite(factor * strength).all():
        raise InputError(path, "materials", f"expected emission of three finite numbers, got {stored!r:.80}")
    return [] if UNLIT in extensions else _within(factor * strength)


def _within(light: Any) -> list[float]:
    """A light as bright as a screen can show it, of the same hue."""
    shown = np.maximum(light, 0)
    return (shown / max(1.0, shown.max())).tolist() if shown.any() else []


def _is_black(about: dict[str, Any]) -> bool:
    """Whether nothing is lost where its light takes the place of its base colour, the holes of its image included."""
    factor, image = about.get("pbrMetallicRoughness", {}).get("baseColorFactor", [1]), _base_image(about)
    same = image is None or _is_solid(about) or image == about.get("emissiveTexture", {}).get("index")
    return GLOSSY not in about.get("extensions", {}) and len(factor) == 4 and not any(factor[:3]) and same


def _base_image(about: dict[str, Any]) -> Any:
    return about.get("pbrMetallicRoughness", {}).get("baseColorTexture", {}).get("index")


def _is_solid(about: dict[str, Any]) -> bool:
    return bool(about.get("alphaMode", "OPAQUE") == "OPAQUE")


def _glowing(about: dict[str, Any], light: list[float]) -> dict[str, Any]:
    base = {"baseColorFactor": [*light, about["pbrMetallicRoughness"]["baseColorFactor"][3]]}
    image = {"baseColorTexture": about["emissiveTexture"]} if "emissiveTexture" in about else {}
    kept = {key: value for key, value in about.items() if not key.startswith("emissive")}
    extensions = {**about.get("extensions", {}), UNLIT: {}}
    whole = {WHOLE: _base_image(about) is None}  # the alpha of a light counts for nothing
    return {**kept, "pbrMetallicRoughness": {**base, **image}, "extensions": extensions, **whole}


def _uncolored(primitive: dict[str, Any], solid: set[int]) -> dict[str, Any]:
    """Without the colours of its vertices, which multiply a base colour and no light, where a material is ``solid``."""
    if primitive.get("material") not in solid:
        return primitive
    attributes = {name: index for name, index in primitive["attributes"].items() if name != "COLOR_0"}
    return {**primitive, "attributes": attributes}


def library_with_glow(text: str, shows: Callable[[str], bool]) -> str:
    """An MTL with the light (``Ke``, ``map_Ke``) of its black materials as their colour, each marked by a key.

    Args:
        text: of the MTL.
        shows: whether the image that a material names can be read; without it the light is not.
    """
    lines = list[str]()
    for block in blocks(text):
        about = said(block)
        light = _library_light(about) if _is_library_black(about) else []
        if light and "map_ke" in about and not shows(about["map_ke"]):
            light = []
        lines += [line for line in block if not light or key_of(line) != "kd"]
        if light:
            lines += [f"Kd {' '.join(map(str, light))}", f"{GLOWS} 1"]
            lines += [f"map_Kd {about['map_ke']}"] if "map_ke" in about else []
    return "\n".join([*lines, ""])


def tell_library_light(library: Path, text: str, shown: set[str]) -> None:
    """Tell which of the materials that are ``shown`` have a light that is not read."""
    told = {name: said(block) for name, block in materials(text).items() if name in shown}
    if names := [name for name, about in told.items() if GLOWS not in about and _library_light(about)]:
        _log.warning("%s: Ke of material %s: %s", library, named(names), _PASSED_OVER)


def _library_light(about: Mapping[str, str]) -> list[float]:
    """Of what a material of an MTL says; see :func:`_light`."""
    light = numbers_of(about.get("ke", "1" if "map_ke" in about else "0"))
    return _within(np.array(light * 3 if len(light) == 1 else light)) if len(light) in (1, 3) else []


def _is_library_black(about: Mapping[str, str]) -> bool:
    return "map_kd" not in about and numbers_of(about.get("kd", "")) in ([0.0], [0.0] * 3)


def numbers_of(words: str) -> list[float]:
    """Finite ones; none where any word is something else."""
    try:
        numbers = [float(word) for word in words.split()]
    except ValueError:
        return []
    return numbers if all(map(math.isfinite, numbers)) else []
