"""nerfstudio's camera_path.json: poses with OpenGL axes and a vertical field of view, for its viewer and renderer."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import torch

from ..camera import intrinsics
from ..errors import InputError
from ..storage.files import write_json
from ..trajectory import Trajectory


def write_camera_path(path: Path, trajectory: Trajectory, fps: float | None = None) -> None:
    """Write ``camera_path.json``, whole or not at all.

    ``camera_path`` is what nerfstudio renders, ``keyframes`` what its viewer loads. Each camera of the former also
    carries its ``time`` [s], which nerfstudio ignores.

    Args:
        path: the file.
        trajectory: the cameras.
        fps: frames a second that nerfstudio plays them at; None: those of the path.

    Raises:
        InputError: pixels are not square or the principal point is not in the middle; the format has no room for it.
    """
    camera, (width, height) = trajectory.camera, trajectory.camera.size
    if not torch.allclose(camera.K, intrinsics(camera.focal, camera.size), rtol=1e-9, atol=1e-6):
        raise InputError(path, "K", "expected square pixels and a principal point in the middle of the frame")
    rate = fps or trajectory.fps
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
        "fps": rate,
        "seconds": len(trajectory) / rate,
        "is_cycle": False,
        "smoothness_value": 0,
        "default_transition_sec": 1 / rate,
        "camera_path": frames,
        "keyframes": _keyframes(frames, 1 / rate),
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
