"""The camera path of a clip, up to the unknown scale, from its frames alone."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp
from torch import Tensor

from ..camera import Camera, intrinsics
from ..trajectory import Trajectory
from . import NoPathError
from .corners import find_corners, match_clip
from .mapping import Clues, Placed, place_frames
from .parallax import require_parallax, weigh
from .points import Points, find_points

FRAME_LIMIT = 120  # more take minutes to match
SECONDS = 60.0


@dataclass(frozen=True)
class Reconstruction:
    """What a clip tells of its camera.

    Args:
        trajectory: a camera for every frame. The world is the axes of the first one, its unit the median depth of all
            points; neither scale nor up is known. Cameras that were not found lie between their neighbours, by their
            times, or stand with the nearest at either end.
        points: what stands still, as the frames whose camera was found see it.
    """

    trajectory: Trajectory
    points: Points


def reconstruct_path(
    frames: Iterable[NDArray],
    subject: Tensor | None,
    times: Tensor,
    lens: float | None = None,
    seconds: float = SECONDS,
) -> Reconstruction:
    """Camera path and sparse points of a clip.

    Args:
        frames: N frames in order, (H, W, 3) uint8 RGB.
        subject: the person's pixels, (N, H, W) bool: it may move, so the cameras do not rely on it. None masks nothing.
        times: of the frames, (N,) [s], increasing.
        lens: focal length [longer sides of the frame] where it is known; None finds it. A camera that moves without
            turning does not tell its lens: depths are then right up to scale, and the path is right for a lens unknown.
        seconds: the mapper may take, as :func:`~cltransfer.sfm.mapping.place_frames` has it; corners, matches and
            points are not counted.

    Raises:
        ModelError: pycolmap is not installed.
        NoPathError: the camera stands still, turns or zooms only, or too little is found again.
        OutOfTimeError: the mapper placed too little in ``seconds``.
    """
    count = len(times)
    if not 3 <= count <= FRAME_LIMIT:
        raise NoPathError("clip", "camera path", f"expected 3 to {FRAME_LIMIT} frames, got {count}", "set frames=48")
    corners, size = [], (0, 0)
    for i, frame in enumerate(frames):
        size = (frame.shape[1], frame.shape[0])
        mask = np.zeros(frame.shape[:2], bool) if subject is None else subject[i].cpu().numpy()
        corners.append(find_corners(frame, mask))
    matches = match_clip(corners)
    evidence = weigh(corners, matches, size[0])
    require_parallax(evidence)
    placed = place_frames(Clues(size, corners, evidence), seconds, lens)
    camera = _between(placed, times)
    points = find_points(camera, corners, matches)
    if len(points.depth) == 0:
        raise NoPathError("clip", "camera path", "no point is seen alike by three frames")
    unit = float(points.depth.median())
    found = torch.zeros(count, dtype=torch.bool)
    found[torch.from_numpy(placed.frames)] = True
    own = found[points.frames]
    kept = Points(
        points.frames[own], points.pixels[own], points.depth[own] / unit, points.confidence[own], points.hidden[own]
    )
    return Reconstruction(Trajectory(_from_first(camera, unit), times.double()), kept)


def _between(placed: Placed, times: Tensor) -> Camera:
    """A camera for each of N frames at ``times`` (N,) [s], from those that were placed."""
    c2w = placed.camera.c2w.numpy()
    known = times.double().numpy()[placed.frames]
    at = times.double().numpy().clip(known[0], known[-1])
    full = np.tile(np.eye(4), (len(at), 1, 1))
    full[:, :3, :3] = Slerp(known, Rotation.from_matrix(c2w[:, :3, :3]))(at).as_matrix()
    for axis in range(3):
        full[:, axis, 3] = np.interp(at, known, c2w[:, axis, 3])
    w2c = torch.from_numpy(full).inverse()
    focal = torch.from_numpy(np.exp(np.interp(at, known, placed.camera.focal.log().numpy())))
    return Camera(w2c, intrinsics(focal, placed.camera.size), placed.camera.size)


def _from_first(camera: Camera, unit: float) -> Camera:
    """The cameras in the axes of the first, lengths in ``unit``."""
    w2c = camera.w2c @ camera.c2w[:1]
    w2c[:, :3, 3] /= unit
    return replace(camera, w2c=w2c)
