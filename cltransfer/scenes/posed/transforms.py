"""transforms.json of nerfstudio, instant-ngp and the Blender sets: OpenGL camera-to-world, one JSON file."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ...storage.files import read_json
from . import PosedImages
from .assemble import View, find_image, inverse, lens_of, numbers, posed_images, rigid, size_of_image
from .lens import Lens
from .points_ply import read_points

_log = logging.getLogger("cltransfer")
MODELS = ("PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV")
DISTORTION = ("k1", "k2", "p1", "p2", "k3")
FOCAL_X, FOCAL_Y = ("fl_x", "camera_angle_x"), ("fl_y", "camera_angle_y")
POINTS = "points3D.ply"  # beside the file, where it names no other
OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])  # x right, y up, z backward, to x right, y down, z forward


def read_transforms(path: Path) -> PosedImages:
    """Images and cameras of a transforms.json; what is stated per frame goes before what is stated once.

    Raises:
        InputError: see :func:`cltransfer.scenes.posed.read_posed`.
    """
    data = read_json(path)
    if not isinstance(data, Mapping) or not isinstance(data.get("frames"), list):
        raise InputError(path, "frames", "expected a list of images", "is it a transforms.json?")
    views = [_view(path, data, frame, index) for index, frame in enumerate(data["frames"])]
    named = data.get("ply_file_path")
    cloud = find_image(path.parent, str(named or POINTS), path, ("", ".ply"))
    if named and cloud is None:
        told = " ".join(str(named).split())
        _log.warning("%s: ply_file_path: no such file, the set has no points: %.80s", path, told)
    return posed_images(path, views, *(read_points(cloud) if cloud else ()))


def _view(path: Path, data: Mapping[str, Any], frame: Any, index: int) -> View:
    where = f"frames[{index}]"
    if not isinstance(frame, Mapping) or not isinstance(frame.get("file_path"), str):
        raise InputError(path, f"{where}.file_path", "expected the name of an image")
    name = frame["file_path"]
    file = find_image(path.parent, name, path)
    pose = numbers(path, f"{where}.transform_matrix", frame.get("transform_matrix"), (4, 4))
    c2w = rigid(path, f"{where}.transform_matrix", pose[:3, :3], pose[:3, 3]) @ OPENGL
    return View(name, file, inverse(c2w), _lens(path, _stated(data, frame), where, file), _mask(path, frame, where))


def _stated(data: Mapping[str, Any], frame: Mapping[str, Any]) -> dict[str, Any]:
    """What holds for a frame; beside a focal length of its own there is none of the file's that says otherwise."""
    own_x, own_y = (any(key in frame for key in keys) for keys in (FOCAL_X, FOCAL_Y))
    dropped = (*FOCAL_X, *FOCAL_Y) if own_x else FOCAL_Y if own_y else ()
    return {**{key: value for key, value in data.items() if key not in dropped}, **frame}


def _mask(path: Path, frame: Mapping[str, Any], where: str) -> Path | None:
    """File of the frame's mask; one that is not there is told when it is read."""
    name = frame.get("mask_path")
    if name is not None and not isinstance(name, str):
        raise InputError(path, f"{where}.mask_path", f"expected the name of an image, got {name!r:.80}")
    return (find_image(path.parent, name, path) or path.parent / name) if name else None


def _lens(path: Path, values: Mapping[str, Any], where: str, file: Path | None) -> Lens:
    model = values.get("camera_model", "OPENCV")
    if model not in MODELS or values.get("is_fisheye") or values.get("k4"):
        kind = model if model not in MODELS else "fisheye"
        raise InputError(path, f"{where}.camera_model", f"{kind} cannot be straightened", f"expected {MODELS[-1]}")

    def number(key: str, default: float | None = None) -> float:
        value = values.get(key, default)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise InputError(path, f"{where}.{key}", f"expected a number, got {value!r:.80}")
        return float(numbers(path, f"{where}.{key}", value, ()))

    size = (number("w"), number("h")) if "w" in values else size_of_image(path, str(values["file_path"]), file)

    def focal(axis: str, side: float) -> float:
        if f"fl_{axis}" in values:
            return number(f"fl_{axis}")
        angle = number(f"camera_angle_{axis}")
        slope = math.tan(angle / 2) if 0 < angle < math.pi else 0.0
        if not slope > 0:
            reason = f"expected an angle above 0 and below pi, got {angle:g}"
            raise InputError(path, f"{where}.camera_angle_{axis}", reason, "give it in radians")
        return side / (2 * slope)

    fx = focal("x", size[0])
    fy = focal("y", size[1]) if any(key in values for key in FOCAL_Y) else fx
    center = (number("cx", size[0] / 2), number("cy", size[1] / 2))
    return lens_of(path, where, size, (fx, fy, *center), [number(key, 0.0) for key in DISTORTION])
