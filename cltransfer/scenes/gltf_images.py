"""Images of a glTF: which of them its materials show, and what those are, before any pixel is decoded."""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..errors import InputError
from .asset_files import Beside
from .gltf_file import Gltf, uri_bytes

FORMATS = ("PNG", "JPEG", "WEBP")  # that are decoded; other decoders are many, and some start programs
GLOSSY = "KHR_materials_pbrSpecularGlossiness"
SHOWN = ("baseColorTexture", "diffuseTexture", "specularGlossinessTexture")


def shown_images(gltf: Gltf, files: Beside) -> tuple[Gltf, dict[str, bytes]]:
    """The document without the images that no material shows, and the others by the names it now has for them.

    Raises:
        InputError: an image that is shown is missing or of another format.
    """
    images: list[dict[str, str]] = [{} for _ in gltf.tree.get("images", [])]
    data: dict[str, bytes] = {}
    for material in gltf.tree.get("materials", []):
        for index in _sources(gltf, material):
            name = f"image {index}"
            if name not in data:
                data[name] = _bytes(gltf, gltf.entry("images", index), files)
                image_size(gltf.path, data[name])
                images[index] = {"uri": name}
    return replace(gltf, tree={**gltf.tree, "images": images}), data


def image_size(path: Path, data: bytes) -> tuple[int, int]:
    """(W, H) [px] of an image file, of which only the header is read.

    Raises:
        InputError: it is no PNG, JPEG or WEBP.
    """
    from PIL import Image

    try:
        with Image.open(io.BytesIO(data), formats=FORMATS) as image:
            return image.size
    except (OSError, ValueError, SyntaxError, EOFError, struct.error, Image.DecompressionBombError):
        raise InputError(path, "images", "a texture cannot be decoded", f"expected {', '.join(FORMATS)}") from None


def _sources(gltf: Gltf, material: dict[str, Any]) -> Iterator[int]:
    """Images that a material shows."""
    glossy = material.get("extensions", {}).get(GLOSSY, {})
    about = {**material, **material.get("pbrMetallicRoughness", {}), **glossy}
    for name in SHOWN:
        if name not in about:
            continue
        texture = gltf.entry("textures", about[name]["index"])
        webp = texture.get("extensions", {}).get("EXT_texture_webp", {}).get("source")
        source = texture.get("source") if webp is None else webp
        if source is not None:
            yield source


def _bytes(gltf: Gltf, image: dict[str, Any], files: Beside) -> bytes:
    if "bufferView" in image:
        return bytes(gltf.view(image["bufferView"]))
    return uri_bytes(gltf.path, "images", image["uri"], files)
