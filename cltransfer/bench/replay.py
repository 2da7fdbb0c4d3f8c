"""Replay: the reference's camera path, rebuilt up to a similarity, played in another scene (paper Sec. 2.3).

It is what a film's path by structure from motion gives when it is taken as it is: subject distance and the scene's
size are not asked. The true path stands for the best that could be rebuilt; :func:`rebuilt` is what is.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..camera import Camera, intrinsics, w2c_of
from ..reading.reference import quantised
from ..scenes import Scene
from ..sfm import NoPathError
from ..sfm.path import reconstruct_path
from ..trajectory import Trajectory


def rebuilt(renderer: Any, scene: Scene, path: Trajectory) -> Camera:
    """The N cameras of ``path`` as structure from motion finds them in its frames, with all of its true extent.

    One number is told it, the root mean square distance of the centres from their middle, and whose pixels are the
    person's. Where the frames tell of no path, as of a camera that stands, turns or zooms, the first camera stays.

    Args:
        renderer: by which the frames are drawn.
        scene: that was filmed.
        path: N cameras at the size of the film.

    Raises:
        ModelError: pycolmap is not installed.
    """
    frames = [renderer.render(scene, path.camera[i], frozenset({"image", "label"})) for i in range(len(path))]
    person = torch.cat([frame.require("label") for frame in frames]) > 0.5

    def images() -> Iterator[NDArray]:
        for frame in frames:
            yield np.ascontiguousarray(quantised(frame.require("image"))[0].permute(1, 2, 0).numpy())

    try:
        found = reconstruct_path(images(), person, path.times).trajectory.camera
    except NoPathError:
        return path.camera[[0] * len(path)]
    scale = _extent(path.camera.center) / _extent(found.center).clamp_min(1e-12)
    w2c = found.w2c.clone()
    w2c[:, :3, 3] *= scale
    return replace(found, w2c=w2c)


def _extent(centers: Tensor) -> Tensor:
    """Root mean square distance of ``centers`` (N, 3) from their middle."""
    return (centers - centers.mean(0)).square().sum(1).mean().sqrt()


def replayed(path: Camera, home: Camera, scale: float, drift: float = 1.0) -> Camera:
    """The motion of ``path`` (N) from ``home`` (1), which stays the first camera.

    Args:
        path: cameras of the reference, in any similarity frame.
        home: first camera in the target scene.
        scale: length of one unit of ``path`` in the target's units, > 0; the ratio of the subjects' heights.
        drift: scale at the last frame as a multiple of that at the first, > 0; it grows evenly from frame to frame,
            as that of a path rebuilt frame by frame does.

    Returns:
        N cameras of the size of ``home``; the focal length goes with that of ``path``.

    Raises:
        ValueError: ``scale`` or ``drift`` is not positive.
    """
    if not (scale > 0 and drift > 0):
        raise ValueError(f"scale and drift must be positive, got {scale} and {drift}")
    steps = path[0].to_camera(path.center)[0].diff(dim=0)  # (N - 1, 3) in the axes of the first camera
    growth = torch.linspace(0, 1, len(path), dtype=torch.float64)[1:, None]
    moved = torch.cat([steps.new_zeros(1, 3), (scale * drift**growth * steps).cumsum(0)])
    R_home = home.w2c[0, :3, :3]
    R = path.w2c[:, :3, :3] @ path.w2c[0, :3, :3].T @ R_home
    center = home.center + moved @ R_home
    return Camera(w2c_of(R, center), intrinsics(home.focal * path.focal / path.focal[0], home.size), home.size)
