"""cameras.json of the INRIA trainer: camera-to-world rotations with OpenCV axes, centres, focal lengths."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...errors import InputError
from ...storage.files import read_json
from . import PosedImages
from .assemble import View, find_image, inverse, lens_of, numbers, posed_images, rigid

FOLDERS = ("images", "input", ".")  # where its images are looked for, beside the file


def read_inria(path: Path) -> PosedImages:
    """Images and cameras of a cameras.json; the principal point is in the middle, the format has no room for it.

    Raises:
        InputError: see :func:`cltransfer.scenes.posed.read_posed`.
    """
    data = read_json(path)
    if not isinstance(data, list):
        raise InputError(path, "", "expected a list of cameras", "is it a cameras.json?")
    return posed_images(path, [_view(path, entry, f"[{index}]") for index, entry in enumerate(data)])


def _view(path: Path, entry: Any, where: str) -> View:
    if not isinstance(entry, Mapping) or not isinstance(entry.get("img_name"), str):
        raise InputError(path, f"{where}.img_name", "expected the name of an image")
    name = entry["img_name"]
    found = [find_image(path.parent, f"{folder}/{name}", path) for folder in FOLDERS]
    R = numbers(path, f"{where}.rotation", entry.get("rotation"), (3, 3))
    t = numbers(path, f"{where}.position", entry.get("position"), (3,))
    width, height, fx, fy = (
        float(numbers(path, f"{where}.{key}", entry.get(key), ())) for key in ("width", "height", "fx", "fy")
    )
    lens = lens_of(path, where, (width, height), (fx, fy, width / 2, height / 2))
    w2c = inverse(rigid(path, f"{where}.rotation", R, t))
    return View(name, next((file for file in found if file), None), w2c, lens)
