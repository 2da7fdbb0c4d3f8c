"""COLMAP's text model: ``cameras.txt``, ``images.txt`` and an empty ``points3D.txt``.

SuperSplat takes ``images.txt`` alone: where each camera stands and looks, without roll and lens.

Its axes, pixels and world to camera are ours (https://colmap.github.io/format.html).
"""

from __future__ import annotations

from pathlib import Path

import torch
from kornia.geometry.conversions import rotation_matrix_to_quaternion

from ..errors import UsageError
from ..storage.files import check_out, write_text
from ..trajectory import Trajectory

NO_POINTS = "# 3D points: none\n"


def check_model(folder: Path) -> None:
    """Refuse a folder with a model that is not of :func:`write_colmap`: photographs may have made it.

    A binary one is refused beside ours too, since programs read it in place of the text.

    Raises:
        UsageError: it is one, or no folder.
    """
    check_out(folder)
    points = folder / "points3D.txt"
    ours = points.is_file() and points.stat().st_size == len(NO_POINTS) and points.read_text() == NO_POINTS
    for kind in ("cameras", "images", "points3D"):
        for file in (folder / f"{kind}.txt", folder / f"{kind}.bin"):
            if file.exists() and not (ours and file.suffix == ".txt"):
                raise UsageError(folder, "--out", f"has a model of its own, {file.name}", "name another folder")


def write_colmap(folder: Path, trajectory: Trajectory) -> None:
    """Write the three files into ``folder``: one camera where the lens stays as it is, else one an image.

    Images are named ``frame_00001.png`` on; they are not written.
    """
    camera, (width, height) = trajectory.camera, trajectory.camera.size
    zooms = not torch.allclose(camera.K, camera.K[:1].expand_as(camera.K), rtol=1e-9, atol=0)
    lenses = camera.K if zooms else camera.K[:1]
    values = [(K[0, 0], K[1, 1], K[0, 2], K[1, 2]) for K in lenses]
    cameras = [f"{n} PINHOLE {width} {height} {_line(*map(float, each))}" for n, each in enumerate(values, 1)]
    turns = rotation_matrix_to_quaternion(camera.w2c[:, :3, :3].contiguous())  # (N, 4), w first
    poses = torch.cat([turns, camera.w2c[:, :3, 3]], dim=1).tolist()
    images = [
        f"{n} {_line(*pose)} {n if zooms else 1} frame_{n:05d}.png\n" for n, pose in enumerate(poses, 1)
    ]  # the line of its points is empty
    write_text(folder / "points3D.txt", NO_POINTS)
    write_text(folder / "cameras.txt", "\n".join(["# CAMERA_ID MODEL WIDTH HEIGHT fx fy cx cy", *cameras]) + "\n")
    write_text(folder / "images.txt", "\n".join(["# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME", *images]) + "\n")


def _line(*values: float) -> str:
    return " ".join(map(repr, values))
