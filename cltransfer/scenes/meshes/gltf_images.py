"""Images of a glTF: which of them its materials show, and what those are, before any pixel is decoded."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...computer.memory import require_free
from .asset_files import Beside
from .gltf_file import Gltf, uri_bytes
from .gltf_places import GLOSSY
from .textures import HINT, check_size, image_size

GLOSSY_BYTES, GLOSSY_KEPT = 320, 8  # of a pixel while trimesh makes base colours of such a material, and after it
SHOWN = ("baseColorTexture", "diffuseTexture", "specularGlossinessTexture")


def shown_images(gltf: Gltf, files: Beside) -> tuple[Gltf, dict[str, bytes]]:
    """The document without the images that no material shows, and the others by the names it now has for them.

    Raises:
        InputError: an image that is shown is missing, too large or of another format.
        ResourceError: there is too little memory to turn its materials into base colours.
    """
    materials = gltf.tree.get("materials", [])
    shown = [list(_sources(gltf, material)) for material in materials]
    indices = dict.fromkeys(index for sources in shown for index in sources)
    data = {index: _bytes(gltf, gltf.entry("images", index), files) for index in indices}
    sizes = {index: image_size(gltf.path, one) for index, one in data.items()}
    glossy = [[sizes[i] for i in one] for one, about in zip(shown, materials) if GLOSSY in about.get("extensions", {})]
    _check_glossy(gltf.path, glossy)
    images = [{"uri": _name(i)} if i in data else {} for i in range(len(gltf.tree.get("images", [])))]
    return replace(gltf, tree={**gltf.tree, "images": images}), {_name(i): one for i, one in data.items()}


def _name(index: int) -> str:
    return f"image {index}"


def _check_glossy(path: Path, materials: list[list[tuple[int, int]]]) -> None:
    """Hold such materials against the memory there is; the images of each are brought to one size."""
    common = [(max(w for w, _ in sizes), max(h for _, h in sizes)) for sizes in materials if sizes]
    for size in common:
        check_size(path, size)
    pixels = [width * height for width, height in common]
    need = GLOSSY_BYTES * max(pixels, default=0) + GLOSSY_KEPT * sum(pixels)
    require_free(need, path, f"materials of {GLOSSY}", HINT)


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
