"""nerfstudio's camera_path.json: poses with OpenGL axes and a vertical field of view, for its viewer and renderer."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from ..camera import Camera, intrinsics
from ..errors import InputError
from ..storage.files import read_json, write_json
from ..trajectory import FRAME_LIMIT, SIZE_LIMIT, Trajectory


def write_camera_path(path: Path, trajectory: Trajectory) -> None:
    """Write ``camera_path.json``, whole or not at all.

    ``camera_path`` is what nerfstudio renders, ``keyframes`` what its viewer loads. Each camera of the former also
    carries its ``time`` [s], which nerfstudio ignores.

    Raises:
        InputError: pixels are not square or the principal point is not in the middle; the format has no room for it.
    """
    camera, (width, height) = trajectory.camera, trajectory.camera.size
    if not torch.allclose(camera.K, intrinsics(camera.focal, camera.size), rtol=1e-9, atol=1e-6):
        raise InputError(path, "K", "expected square pixels and a principal point in the middle of the frame")
    frames = [
        {
            "camera_to_world": pose.flatten().tolist(),
            "fov": math.degrees(fov),
            "aspect": width / height,
            "time": time,
        }
        for pose, fov, time in zip(camera.to_opengl(), camera.vertical_fov.tolist(), trajectory.times.tolist())
    ]
    write_json(path, {
        "camera_type": "perspective",
        "render_height": height,
        "render_width": width,
        "fps": trajectory.fps,
        "seconds": len(trajectory) / trajectory.fps,
        "is_cycle": False,
        "smoothness_value": 0,
        "default_transition_sec": 1 / trajectory.fps,
        "camera_path": frames,
        "keyframes": _keyframes(frames, 1 / trajectory.fps),
    })  # fmt: skip


def _keyframes(frames: Sequence[Mapping[str, Any]], usual: float) -> list[dict[str, Any]]:
    """What the viewer's "Load Path" reads: every camera with the seconds since the one before; the first has ``usual``.

    As nerfstudio/viewer/render_panel.py has it, where a transition leads to its keyframe. It takes a keyframe whose
    ``fov`` is the file's ``default_fov`` for one without, so there is no ``default_fov``.
    """
    since = [usual, *(later["time"] - earlier["time"] for earlier, later in pairwise(frames))]
    return [
        {
            "matrix": frame["camera_to_world"],
            "fov": frame["fov"],
            "aspect": frame["aspect"],
            "override_transition_enabled": True,
            "override_transition_sec": seconds,
        }
        for frame, seconds in zip(frames, since)
    ]


def read_camera_path(path: Path) -> Trajectory:
    """Read a ``camera_path.json`` written here, by nerfstudio or by its Blender add-on.

    Cameras without a ``time`` [s] of their own follow each other at ``fps``.

    Raises:
        InputError: the file is missing or a field is missing, of the wrong type, out of range or not a pose.
    """
    data = read_json(path)
    if not isinstance(data, Mapping) or "camera_path" not in data:
        raise InputError(path, "camera_path", "field is missing", "is it a nerfstudio camera path?")
    if data.get("camera_type", "perspective") != "perspective":
        raise InputError(path, "camera_type", f"expected 'perspective', got {data['camera_type']!r}")
    frames = data["camera_path"]
    if not isinstance(frames, list) or not 1 <= len(frames) <= FRAME_LIMIT:
        raise InputError(path, "camera_path", f"expected a list of 1 to {FRAME_LIMIT} cameras")
    width, height = (_number(path, data, f"render_{name}", 1, SIZE_LIMIT) for name in ("width", "height"))
    size = (round(width), round(height))
    poses, fovs = [], []
    for index, frame in enumerate(frames):
        if not isinstance(frame, Mapping):
            raise InputError(path, f"camera_path[{index}]", "expected an object")
        where = f"camera_path[{index}]."
        poses.append(_pose(path, frame.get("camera_to_world"), where + "camera_to_world"))
        fovs.append(math.radians(_number(path, frame, "fov", 1e-3, 179.9, where)))
    focal = size[1] / (2 * torch.tan(torch.tensor(fovs, dtype=torch.float64) / 2))
    camera = Camera.from_opengl(torch.stack(poses), intrinsics(focal, size), size)
    return Trajectory(camera, _times(path, data, frames))


def _number(path: Path, data: Mapping[str, Any], name: str, low: float, high: float, prefix: str = "") -> float:
    """Field ``name`` as a number in [low, high]."""
    value = data.get(name)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
        raise InputError(path, prefix + name, f"expected a number in [{low:g}, {high:g}], got {value!r}")
    return float(value)


def _pose(path: Path, value: Any, field: str) -> Tensor:
    """Camera-to-world, (4, 4), of 16 numbers, row by row."""
    try:
        pose = torch.tensor(value, dtype=torch.float64).reshape(4, 4)
    except (TypeError, ValueError, RuntimeError, OverflowError):
        raise InputError(path, field, "expected 16 numbers") from None
    R = pose[:3, :3]
    rotation = (R @ R.T - torch.eye(3, dtype=R.dtype)).abs().amax() < 1e-4 and torch.linalg.det(R) > 0
    last = torch.equal(pose[3], torch.tensor([0, 0, 0, 1], dtype=R.dtype))
    if not (bool(torch.isfinite(pose).all()) and bool(rotation) and last):
        raise InputError(path, field, "expected a rotation, a position and 0 0 0 1 as the last row")
    return pose


def _times(path: Path, data: Mapping[str, Any], frames: list[Mapping[str, Any]]) -> Tensor:
    """Times (N,) [s]: each camera's own, else by the frame rate."""
    if all("time" in frame for frame in frames):
        times = [_number(path, f, "time", -1e9, 1e9, f"camera_path[{i}].") for i, f in enumerate(frames)]
    else:
        fps = _number(path, data, "fps", 1e-3, 1e4)
        times = [index / fps for index in range(len(frames))]
    if any(later <= earlier for earlier, later in pairwise(times)):
        raise InputError(path, "camera_path", "expected times that increase from camera to camera")
    return torch.tensor(times, dtype=torch.float64)
