"""The materials of an OBJ: which image each of them shows. trimesh goes on without an image that it cannot open."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ..errors import InputError
from .asset_files import read_limited
from .textures import FORMATS, image_of

LIBRARY_LIMIT = 4 * 2**20  # bytes; trimesh takes up to 45 times what the file does


def check_images(library: Path, visuals: Iterable[Any]) -> None:
    """Refuse a material whose image was not opened.

    Args:
        library: the .mtl that says what they show.
        visuals: those of trimesh; without places in a texture one shows no image.

    Raises:
        InputError: a material names an image and has none.
    """
    materials = [getattr(one, "material", None) for one in visuals if getattr(one, "uv", None) is not None]
    bare = {one.name for one in materials if one is not None and image_of(one) is None}
    if not bare:
        return
    for name, image in _images(library).items():
        if name in bare:
            reason = f"{image[:80]!r} of material {name[:40]!r} cannot be decoded"
            raise InputError(library, "map_Kd", reason, f"expected {', '.join(FORMATS)}")


def _images(library: Path) -> dict[str, str]:
    """Name of the image file by name of the material, read as trimesh reads them: of one name the last counts."""
    from trimesh.util import decode_text

    found: dict[str, str] = {}
    material = None
    for line in decode_text(read_limited(library, LIBRARY_LIMIT)).splitlines():
        key, *words = line.split() or [""]
        if key.lower() == "newmtl" and words:
            material = " ".join(words)
            found.pop(material, None)
        elif key.lower() == "map_kd" and words and material is not None:
            found[material] = line.strip()[len(key) :].strip()
    return found
