"""Images of a glTF: which of them its materials show, and what those are, before any pixel is decoded."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
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
        ResourceError: there is too little memory to copy the images or to turn its materials into base colours.
    """
    materials = gltf.tree.get("materials", [])
    shown = [list(_sources(gltf, material)) for material in materials]
    indices = dict.fromkeys(index for sources in shown for index in sources)
    data = _stored(gltf, indices, files)
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


def _stored(gltf: Gltf, indices: Iterable[int], files: Beside) -> dict[int, bytes]:
    """The files of images by index; of a buffer view that many images name there is one copy."""
    about = {index: gltf.entry("images", index) for index in indices}
    views = {one["bufferView"]: gltf.view(one["bufferView"]) for one in about.values() if "bufferView" in one}
    require_free(sum(map(len, views.values())), gltf.path, f"{len(views)} images in its buffers", HINT)
    copies = {index: bytes(view) for index, view in views.items()}
    return {
        index: copies[one["bufferView"]] if "bufferView" in one else uri_bytes(gltf.path, "images", one["uri"], files)
        for index, one in about.items()
    }
