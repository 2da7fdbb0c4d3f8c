"""Glass of a glTF: a material that lets light through, whatever its alpha is."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

from ...errors import InputError
from .glow import named

GLASS = "KHR_materials_transmission"

_log = logging.getLogger("cltransfer")


def transmission_of(path: Path, material: dict[str, Any]) -> float:
    """Share of the light that a material lets through, [0, 1]; 0 where an image says where, which is not read.

    Raises:
        InputError: it is no such share.
    """
    about = material.get("extensions", {}).get(GLASS, {})
    share = about.get("transmissionFactor", 0)
    if not isinstance(share, (int, float)) or not 0 <= share <= 1:
        raise InputError(path, "materials", f"expected a transmissionFactor in [0, 1], got {share!r:.40}")
    return 0.0 if "transmissionTexture" in about else float(share)


def tell_unread(path: Path, tree: dict[str, Any]) -> None:
    """Tell which of the materials that a mesh has let light through where an image says so, and are drawn whole."""
    used = {primitive.get("material") for mesh in tree["meshes"] for primitive in mesh["primitives"]}
    told = [
        str(about.get("name", index))
        for index, about in enumerate(tree.get("materials", []))
        if index in used and "transmissionTexture" in about.get("extensions", {}).get(GLASS, {})
    ]
    if told:
        _log.warning("%s: material %s: an image of where it lets light through is not read, all of it is drawn",
                     path, named(told))  # fmt: skip
