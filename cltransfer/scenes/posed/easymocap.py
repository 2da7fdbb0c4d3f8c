"""intri.yml and extri.yml of EasyMocap, as ENeRF-Outdoor and Mobile-Stage have them: OpenCV world-to-camera."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...clips.decoding import IMAGE_SUFFIXES
from ...clips.image_folder import natural_order
from ...computer.array_type import Array
from ...errors import InputError
from ...storage.files import refuse_outside
from . import POSED_VIDEOS, PosedImages
from .assemble import View, find_image, lens_of, names_in, posed_images, rigid, size_of_image
from .lens import Lens
from .opencv_yaml import Values, read_opencv_yaml


def read_easymocap(folder: Path) -> PosedImages:
    """Images and cameras of a folder with intri.yml and extri.yml.

    The image of camera NAME is ``images/NAME.*``, the first file of ``images/NAME/``, or ``videos/NAME.mp4``.

    Raises:
        InputError: see :func:`cltransfer.scenes.posed.read_posed`.
    """
    inside, outside = folder / "intri.yml", folder / "extri.yml"
    refuse_outside(folder, (inside, outside), "set")
    intrinsics, extrinsics = read_opencv_yaml(inside), read_opencv_yaml(outside)
    names = intrinsics.get("names")
    if not isinstance(names, list) or not names:
        raise InputError(inside, "names", "expected a list of cameras")
    views = []
    for name in names:
        file = _file(folder, name)
        lens = _lens(inside, intrinsics, name, file)
        R = _matrix(outside, extrinsics, f"Rot_{name}", (3, 3))
        t = _matrix(outside, extrinsics, f"T_{name}", (3, 1))[:, 0]
        views.append(View(name, file, rigid(outside, f"Rot_{name}", R, t), lens))
    return replace(posed_images(folder, views), exif=True)  # it calibrates what cv2.imread has turned


def _lens(path: Path, values: Values, name: str, file: Path | None) -> Lens:
    K = _matrix(path, values, f"K_{name}", (3, 3))
    width, height = values.get(f"W_{name}"), values.get(f"H_{name}")
    size: tuple[float, float]
    if isinstance(width, float) and isinstance(height, float):
        size = (width, height)
    else:
        size = size_of_image(path, name, file, exif=True)
    bend = np.ravel(_matrix(path, values, f"dist_{name}")) if f"dist_{name}" in values else np.empty(0)
    if len(bend) not in (0, 4, 5, 8):
        raise InputError(path, f"dist_{name}", f"expected 4, 5 or 8 numbers, got {len(bend)}")
    # OpenCV has the centre of the first pixel at 0
    intrinsics = [K[0, 0], K[1, 1], K[0, 2] + 0.5, K[1, 2] + 0.5]
    return lens_of(path, f"K_{name}", size, [float(v) for v in intrinsics], bend.tolist())


def _matrix(path: Path, values: Values, key: str, shape: tuple[int, int] | None = None) -> Array:
    value = values.get(key)
    if not isinstance(value, np.ndarray) or (shape is not None and value.shape != shape):
        wanted = "a matrix" if shape is None else f"a {shape[0]} x {shape[1]} matrix"
        raise InputError(path, key, f"expected {wanted}" + (", it is missing" if value is None else ""))
    return value


def _file(folder: Path, name: str) -> Path | None:
    """The image or video of a camera."""
    where = folder / "intri.yml"
    found = find_image(folder, f"images/{name}", where) or find_image(folder, f"videos/{name}", where, POSED_VIDEOS)
    frames = folder / "images" / name
    if found is None and os.path.isdir(frames) and frames.resolve().is_relative_to(folder.resolve()):
        names = sorted(names_in(frames, IMAGE_SUFFIXES), key=natural_order)
        found = find_image(folder, f"images/{name}/{names[0]}", where) if names else None
    return found
