"""The textures of a mesh file: each decoded once, and none before all of them are known to fit."""

from __future__ import annotations

import io
import struct
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ...computer.array_type import Array
from ...computer.memory import require_free
from ...errors import InputError

FORMATS = ("PNG", "JPEG", "WEBP")  # that are decoded; other decoders are many, and some start programs
IMAGE_LIMIT = 2**26  # pixels of one texture
TOTAL_LIMIT = 2**30  # pixels of all
PIXEL_BYTES = 24  # of a texture while it is decoded and packed
DEEP = 257  # levels of 16 bits for one of 8
HINT = "make the textures smaller"
_DAMAGED = (OSError, ValueError, SyntaxError, EOFError, struct.error)  # that Pillow raises of what it cannot decode
_DECODED = (*FORMATS, "MPO", None)  # MPO: a JPEG with further pictures behind it; None: what trimesh made of them


def image_size(path: Path, data: bytes | None = None) -> tuple[int, int]:
    """(W, H) [px] of an image file, of which only the header is read.

    Args:
        path: for error lines.
        data: of the image; None: ``path`` is its file.

    Raises:
        InputError: it is no PNG, JPEG or WEBP, or too large.
    """
    from PIL import Image

    try:
        with Image.open(path if data is None else io.BytesIO(data), formats=FORMATS) as image:
            size = image.size
    except Image.DecompressionBombError:  # tells no size
        raise InputError(path, "texture", f"expected at most {IMAGE_LIMIT} pixels, got more", HINT) from None
    except _DAMAGED:
        raise InputError(path, "images", "a texture cannot be decoded", f"expected {', '.join(FORMATS)}") from None
    check_size(path, size)
    return size


def decodes(path: Path) -> bool:
    """Whether the file is an image that is read, all of it, and not too large.

    Raises:
        ResourceError: it does not fit in memory.
    """
    from PIL import Image

    try:
        width, height = image_size(path)
        require_free(PIXEL_BYTES * width * height, path, f"a texture's {width}x{height} pixels", HINT)
        with Image.open(path, formats=FORMATS) as image:
            image.load()
    except (InputError, *_DAMAGED):
        return False
    return True


def check_size(path: Path, size: tuple[int, int]) -> None:
    """Refuse a texture of more pixels than one may have.

    Raises:
        InputError: it has more.
    """
    if size[0] * size[1] > IMAGE_LIMIT:
        raise InputError(path, "texture", f"expected at most {IMAGE_LIMIT} pixels, got {size[0]}x{size[1]}", HINT)


def image_of(material: Any) -> Any:
    """The image, not decoded yet, that a trimesh material shows as its colours; None if it has none."""
    return getattr(material, "baseColorTexture", None) or getattr(material, "image", None)


class Textures:
    """The textures of some trimesh materials.

    Args:
        path: the file, for error lines.
        materials: all that will be asked for.
        least: alpha below which a material has holes, by its name; 0 where it is not there.

    Raises:
        InputError: an image is of a format that is not read, or they have more pixels than the limits.
        ResourceError: they do not fit in memory.
    """

    def __init__(self, path: Path, materials: Iterable[Any], least: Mapping[str, float]) -> None:
        self._path, self._least = path, least
        images = {self._key(one): image_of(one) for one in materials if image_of(one) is not None}
        for image in images.values():
            if image.format not in _DECODED:
                raise InputError(path, "texture", f"{image.format} is not read", f"expected {', '.join(FORMATS)}")
            check_size(path, image.size)
        total = sum(image.width * image.height for image in images.values())
        if total > TOTAL_LIMIT:
            reason = f"expected at most {TOTAL_LIMIT} pixels in all, got {total}"
            raise InputError(path, "textures", reason, HINT)
        require_free(PIXEL_BYTES * total, path, f"textures of {total} pixels", HINT)
        self._images = images
        self._decoded: dict[tuple[Any, float], Tensor] = {}

    def of(self, material: Any) -> Tensor:
        """RGBA (h, w, 4) uint8, the same tensor for the same image; alpha is 0 in holes and 255 elsewhere.

        Raises:
            InputError: the image is damaged.
        """
        key = self._key(material)
        if key not in self._decoded:
            pixels = _pixels(self._path, self._images[key])
            pixels[..., 3] = (pixels[..., 3] >= 255 * key[1]) * np.uint8(255)
            self._decoded[key] = torch.from_numpy(pixels)
        return self._decoded[key]

    def _key(self, material: Any) -> tuple[Any, float]:
        """Which image, and the alpha below which it has holes; an OBJ opens a file anew for each of its materials."""
        image = image_of(material)
        name = None if getattr(material, "baseColorTexture", None) is image else image.info.get("file_path")
        return id(image) if name is None else name, self._least.get(str(getattr(material, "name", "")), 0.0)


def _pixels(path: Path, image: Any) -> Array:
    """RGBA (h, w, 4) uint8 of an image that is not decoded yet."""
    from PIL import Image

    try:
        if image.mode.startswith("I"):  # 16 bits of grey, which would be cut off at 255
            gray = np.asarray(image).astype(np.float32) / DEEP
            image = Image.fromarray(gray.round().astype(np.uint8))
        return np.array(image.convert("RGBA"))
    except _DAMAGED:
        name = image.info.get("file_path")  # as an OBJ names it
        what = "a texture" if name is None else repr(name[:80])
        raise InputError(path, "images", f"{what} cannot be decoded", "is it cut short?") from None
