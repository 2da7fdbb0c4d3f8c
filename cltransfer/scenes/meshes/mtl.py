"""The materials of an OBJ: which image each of them shows, and how. trimesh goes on without one it cannot open."""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...computer.array_type import Array
from ...errors import InputError, ResourceError
from .asset_files import Beside, read_limited
from .glow import GLOWS, library_with_glow, named, numbers_of, tell_library_light
from .mesh import CLAMPED, REPEATED
from .mesh_paint import HALF, Look
from .mtl_text import key_of, materials, said, with_whole_colors
from .textures import FORMATS, decodes, image_of

WITHOUT = " (without places)"  # behind the name of a material: what shows it has no places in its image
JOINED = "the libraries of this file"  # that it names, as one
BOM = b"\xef\xbb\xbf"  # before the first line, of some programs
HABITS = {0.0, 0.588, 0.64, 0.8, 1.0}  # greys that programs write beside an image whatever it shows
LIBRARY_LIMIT = 4 * 2**20  # bytes; trimesh takes up to 45 times what the file does

_NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:e[-+]?\d+)?"
_SWITCH = r"(?:blendu|blendv|cc|clamp|imfchan|boost|bm|texres|type)\s+\S+"
_OPTIONS = re.compile(rf"(?:-(?:{_SWITCH}|mm\s+\S+\s+\S+|[ost](?:\s+{_NUMBER}){{1,3}})\s+)+", re.IGNORECASE)
_PLACED = re.compile(rf"-([os])((?:\s+{_NUMBER}){{1,3}})\s", re.IGNORECASE)
_CLAMPED = re.compile(r"-clamp\s+on\s", re.IGNORECASE)

_log = logging.getLogger("cltransfer")


class ObjFiles(Beside):
    """The files of an OBJ; before the name of an image an MTL may have options."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, LIBRARY_LIMIT)
        self.libraries: dict[Path, str] = {}  # what those that it names say, in order
        self._joined = b""
        self._decoded: dict[Path, bool] = {}  # images that materials shine by, whether they are any

    def named(self, line: str) -> list[str]:
        """The libraries of a line: one whose name has spaces, or several with spaces between."""
        alone = os.path.isfile(self.path.parent / line) or not line.strip()
        return [line] if alone else line.split()

    def join(self, names: Sequence[str], without: Collection[str]) -> str:
        """The name of a library that holds those of ``names``, and beside each material of ``without`` a plain one.

        Raises:
            InputError: one is not there, empty, or they are larger than a library may be.
        """
        size = 0
        for library in dict.fromkeys(map(self.find, names)):  # one may be spelt in many ways
            self.libraries[library] = self._text(read_limited(library, LIBRARY_LIMIT))
            size += len(self.libraries[library])
            self._check_size(size)
        text = "\n".join(self.libraries.values())
        text += "".join(_plain(text, material) for material in sorted(without))
        self._joined = text.encode()
        self._check_size(len(self._joined))
        return JOINED

    def _check_size(self, size: int) -> None:
        if size > LIBRARY_LIMIT:
            raise InputError(self.path, "mtllib", f"expected at most {LIBRARY_LIMIT} bytes, got {size}")

    def get(self, name: str) -> bytes:
        """Bytes of the file ``name``, or of what was joined."""
        if name == JOINED and self._joined:
            return self._joined
        data = super().get(name)
        if self.libraries:
            return data
        text = self._text(data)
        self.libraries[self.given[0]] = text  # what is asked for first
        return text.encode()

    __getitem__ = get

    def place(self, name: str) -> Path:
        """The file ``name`` beside or below, with or without options; see :meth:`Beside.place`."""
        return super().place(name if os.path.isfile(self.path.parent / name) else _without_options(name))

    def _text(self, data: bytes) -> str:
        """What a library says, as trimesh is to read it."""
        from trimesh.util import decode_text

        text = str(decode_text(data.removeprefix(BOM)))
        return library_with_glow(with_whole_colors(text), self._shows)

    def _shows(self, name: str) -> bool:
        """Whether the image ``name`` is there, and one that is decoded, which is tried once for however many materials.

        Raises:
            ResourceError: there is no memory for it.
        """
        try:
            file = self.place(name).resolve()
        except InputError:
            return False
        try:
            if file not in self._decoded:
                self._decoded[file] = decodes(file)
        except ResourceError as error:
            self.refused = self.refused or error
            raise
        return self._decoded[file]


def _without_options(name: str) -> str:
    return name[len(_options(name)) :]


def _options(name: str) -> str:
    """What stands before the name of an image."""
    options = _OPTIONS.match(name)
    return options[0] if options else ""


def _plain(text: str, material: str) -> str:
    """What a library says of ``material``, under its name for faces without places, without an image."""
    kept = [line for line in materials(text).get(material, []) if key_of(line) not in ("newmtl", "map_kd")]
    return "\n".join([f"\nnewmtl {material}{WITHOUT}", *kept, ""])


def looks_of(visuals: Iterable[Any]) -> dict[str, Look]:
    """What the materials of an OBJ say that trimesh does not pass on, by their names.

    Less than half opaque by ``d`` is not drawn, as in a glTF; ``-o``, ``-s`` and ``-clamp on`` place the image. ``Kd``
    multiplies an image where it has a hue, and is passed over where it is grey: many programs write one by habit beside
    an image that is to be shown as it is, even black. So are bumps, turbulence, ``map_d`` and most lights; all but the
    first two of these, and a grey of no habit, are told, see :func:`tell_passed_over`.

    Args:
        visuals: those of trimesh.
    """
    materials = [getattr(one, "material", None) for one in visuals]
    return {one.name: _look(one) for one in materials if one is not None}


def _look(material: Any) -> Look:
    about = getattr(material, "kwargs", {})
    image, opacity, lit = image_of(material), _opacity(about), False if GLOWS in about else None
    options = "" if image is None else _options(str(image.info.get("file_path", "")))
    wraps = CLAMPED if _CLAMPED.search(options) else REPEATED
    cutoff = HALF * (opacity < HALF)
    look = Look(lit, textured=False, transform=_transform(options), wraps=wraps, opacity=opacity, cutoff=cutoff)
    return replace(look, color=_color(material))


def _color(material: Any) -> tuple[float, float, float] | None:
    """Of :class:`Look`: what ``Kd`` says, beside an image where that is a hue, or the light by which it shines."""
    if "kd" not in material.kwargs:
        return None  # trimesh makes a dark grey up
    red, green, blue = (float(level / 255) for level in material.diffuse[:3])
    plain = red == green == blue and GLOWS not in material.kwargs
    return None if plain and image_of(material) is not None else (red, green, blue)


def _opacity(about: Mapping[str, Any]) -> float:
    """In [0, 1]; ``Tr`` is what ``d`` lacks, and does not count beside it: some write it the other way round."""
    try:
        if "d" in about:
            return min(max(float(about["d"][-1]), 0.0), 1.0)
        return min(max(1 - float(about["tr"][-1]), 0.0), 1.0) if "tr" in about else 1.0
    except (ValueError, TypeError):
        return 1.0  # no number, as trimesh passes over a colour that is none


def _transform(options: str) -> Array | None:
    """From texture coordinates to places in the texture, (2, 3), from its top left; None where they are the same."""
    said = {key.lower(): [float(word) for word in words.split()] for key, words in _PLACED.findall(options)}
    if not said:
        return None
    su, sv = [*said.get("s", []), 1.0, 1.0][:2]
    ou, ov = [*said.get("o", []), 0.0, 0.0][:2]
    return np.array([[su, 0, ou], [0, sv, 1 - sv - ov]])  # an MTL counts from the bottom: v' = sv v + ov


def check_images(libraries: Mapping[Path, str], visuals: Iterable[Any]) -> None:
    """Refuse a material whose image was not opened.

    Args:
        libraries: texts of the .mtl files that say what they show.
        visuals: those of trimesh; without places in a texture one shows no image.

    Raises:
        InputError: a material names an image and has none.
    """
    materials = [getattr(one, "material", None) for one in visuals if getattr(one, "uv", None) is not None]
    bare = {one.name for one in materials if one is not None and image_of(one) is None}
    if not bare:
        return
    for library, name, image in ((file, *both) for file, text in libraries.items() for both in _images(text).items()):
        if name in bare:
            reason = f"{image[:80]!r} of material {name[:40]!r} cannot be decoded"
            raise InputError(library, "map_Kd", reason, f"expected {', '.join(FORMATS)}")


def tell_passed_over(libraries: Mapping[Path, str], visuals: Iterable[Any]) -> None:
    """Tell which materials are drawn whole though an image, ``map_d``, says where they are not, or without their light.

    So are those whose image is drawn brighter than their grey, ``Kd``, says, where no program writes that by habit.

    Args:
        libraries: texts of the .mtl files that say so.
        visuals: those of trimesh.
    """
    shown = {material.name for one in visuals if (material := getattr(one, "material", None)) is not None}
    for library, text in libraries.items():
        if cut := [name for name in _images(text, "map_d") if name in shown]:
            told = "%s: map_d of material %s: images of opacity are not read, all of it is drawn"
            _log.warning(told, library, named(cut))
        if bright := [name for name, block in materials(text).items() if name in shown and _is_dimmed(said(block))]:
            told = "%s: Kd of material %s: a grey beside map_Kd is not read, its image is drawn as it is"
            _log.warning(told, library, named(bright))
        tell_library_light(library, text, shown)


def _is_dimmed(about: Mapping[str, str]) -> bool:
    """Whether a material multiplies its image by a grey that was meant."""
    if "map_kd" not in about or GLOWS in about:
        return False
    levels = {round(level, 3) for level in numbers_of(about.get("kd", ""))}
    return len(levels) == 1 and not levels & HABITS


def _images(text: str, kind: str = "map_kd") -> dict[str, str]:
    """Name of the image file by name of the material."""
    told = {name: said(block) for name, block in materials(text).items()}
    return {name: about[kind] for name, about in told.items() if kind in about}
