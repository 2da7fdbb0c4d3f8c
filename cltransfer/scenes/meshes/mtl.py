"""The materials of an OBJ: which image each of them shows. trimesh goes on without an image that it cannot open."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ...errors import InputError
from .asset_files import Beside, read_limited
from .textures import FORMATS, image_of

LIBRARY_LIMIT = 4 * 2**20  # bytes; trimesh takes up to 45 times what the file does

_NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:e[-+]?\d+)?"
_SWITCH = r"(?:blendu|blendv|cc|clamp|imfchan|boost|bm|texres|type)\s+\S+"
_OPTIONS = re.compile(rf"(?:-(?:{_SWITCH}|mm\s+\S+\s+\S+|[ost](?:\s+{_NUMBER}){{1,3}})\s+)+", re.IGNORECASE)


class ObjFiles(Beside):
    """The files of an OBJ; before the name of an image an MTL may have options, which are passed over."""

    def find(self, name: str) -> Path:
        """The file ``name`` beside or below, with or without options; see :meth:`Beside.find`."""
        return super().find(name if os.path.isfile(self.path.parent / name) else _without_options(name))


def _without_options(name: str) -> str:
    options = _OPTIONS.match(name)
    return name[options.end() :] if options else name


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
