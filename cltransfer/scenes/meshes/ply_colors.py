"""Colours of a PLY by the types of their columns: of wide ones trimesh keeps the low byte."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...computer.array_type import Array
from ...errors import InputError

CHANNELS = ("red", "green", "blue")


def own_visual(path: Path, geometry: Any) -> Any:
    """The look of a trimesh geometry of a PLY without its texture: the colours of its faces or vertices.

    Raises:
        InputError: a colour is stored in a type whose range says nothing, and is not in [0, 255].
    """
    from trimesh.visual import create_visual

    raw = geometry.metadata["_ply_raw"]
    colors = {f"{name}_colors": _stored(path, name, raw[name]) for name in ("face", "vertex") if name in raw}
    return create_visual(mesh=geometry, **colors)


def _stored(path: Path, name: str, element: dict[str, Any]) -> Array | None:
    """Colours as trimesh takes them, (N, 3) uint8 or floats in [0, 1]; None where there are none."""
    if not all(channel in element["properties"] for channel in CHANNELS):
        return None
    colors = np.column_stack([element["data"][channel] for channel in CHANNELS])
    if colors.dtype.kind == "f" or colors.dtype == np.uint8:
        return colors
    if colors.dtype.kind == "u" and colors.dtype.itemsize == 2:
        return np.asarray(colors / np.float32(np.iinfo(np.uint16).max))
    wrong = colors[(colors < 0) | (colors > 255)]
    if len(wrong):
        reason = f"expected colours of uchar, ushort or float, got {wrong[0]} in a column of {colors.dtype}"
        raise InputError(path, f"element {name}", reason, "store them as uchar")
    return colors.astype(np.uint8)
