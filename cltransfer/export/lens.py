"""What camera files of other programs share: a gate, frame numbers in place of seconds, pixels that a film can have."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from ..camera import Camera, fitted_size
from ..errors import InputError
from ..trajectory import Trajectory

FULL_FRAME = 36.0  # [mm] wide, the gate that focal lengths are told for
NEAR, FAR = 1e-3, 1e6  # scene units that programs are told to draw between, wide: the units are not known
USUAL = 24.0  # frames a second, of a path too sparse to be one
SPARSE = 12.0  # frames a second below which it is


@dataclass(frozen=True)
class Lens:
    """N lenses behind a gate :data:`FULL_FRAME` wide.

    Args:
        focal: focal length, (N,) [mm].
        shift: of the gate's middle from the optical axis, to the right and up, (N, 2), parts of its width.
    """

    focal: Tensor  # (N,) [mm]
    shift: Tensor  # (N, 2)

    @classmethod
    def of(cls, camera: Camera, path: Path) -> Lens:
        """Those of N cameras.

        Raises:
            InputError: pixels are not square; what ``path`` is to hold has no room for it.
        """
        (width, height), K = camera.size, camera.K
        if not torch.allclose(K[:, 0, 0], K[:, 1, 1], rtol=1e-9, atol=1e-6):
            raise InputError(path, "K", "expected square pixels", "a folder keeps others, as COLMAP's text model")
        shift = torch.stack([width / 2 - K[:, 0, 2], K[:, 1, 2] - height / 2], dim=1)
        return cls(millimetres(camera), shift / width)


def millimetres(camera: Camera) -> Tensor:
    """Focal length of B cameras behind a gate :data:`FULL_FRAME` wide, (B,) [mm]."""
    return camera.focal * FULL_FRAME / camera.size[0]


def at_side(trajectory: Trajectory, side: int) -> Trajectory:
    """The same cameras on a picture of the same shape whose longer side is ``side`` [px], as ``render`` draws them.

    The vertical field of view is kept, and pixels that are not square and a principal point beside the middle too.
    """
    camera = trajectory.camera
    size = fitted_size(camera.size, side)
    if size == camera.size:
        return trajectory
    scale, K = size[1] / camera.size[1], camera.K.clone()
    K[:, :2] *= scale
    K[:, :2, 2] += (K.new_tensor(size) - scale * K.new_tensor(camera.size)) / 2
    return Trajectory(Camera(camera.w2c, K, size), trajectory.times)


def filmable(trajectory: Trajectory, centred: bool = False) -> Trajectory:
    """The same pixels, and a column and a row more where theirs are odd in number, as H.264 has to have them.

    Args:
        trajectory: the cameras.
        centred: half of them on either side, by which the middle stays one; else on the right and below, as a run's
            own videos have them.
    """
    camera = trajectory.camera
    more = [side % 2 for side in camera.size]
    if not any(more):
        return trajectory
    K = camera.K.clone()
    if centred:
        K[:, :2, 2] += K.new_tensor(more) / 2
    return Trajectory(Camera(camera.w2c, K, (camera.size[0] + more[0], camera.size[1] + more[1])), trajectory.times)


def rate_of(trajectory: Trajectory) -> float:
    """Frames a second to number frames by: those of the path, or :data:`USUAL` where it has only some of them."""
    return trajectory.fps if trajectory.fps >= SPARSE else USUAL


def frame_numbers(trajectory: Trajectory, rate: float) -> list[float]:
    """When each camera stands, in frames at ``rate`` since the first; a fraction where it stands between two."""
    return [round(number, 6) for number in ((trajectory.times - trajectory.times[0]) * rate).tolist()]
