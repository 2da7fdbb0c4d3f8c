"""The eight numbers of JAWS: an exponential of (v, w, theta) from the left in the world, and the lens."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import torch
from kornia.geometry.conversions import rotation_matrix_to_axis_angle, vector_to_skew_symmetric_matrix
from kornia.geometry.linalg import inverse_transformation
from torch import Tensor

from ..camera import Camera
from ..registry import SEARCHES
from ..subject import Subject

SHORTEST, LONGEST = 0.06, 6.0  # a scene unit in subject heights, beyond which it is far from a metre
LEAST_TURN = 1e-6  # [rad]; without any turn a unit axis allows no translation


def exponential(v: Tensor, w: Tensor, theta: Tensor) -> tuple[Tensor, Tensor]:
    """Rotation and translation of a screw: the exponential map that JAWS writes out.

    R = I + sin(theta) [w] + (1 - cos(theta)) [w]^2,
    p = (theta I + (1 - cos(theta)) [w] + (theta - sin(theta)) [w]^2) v.

    Args:
        v: (B, 3), scene units a radian.
        w: axis, (B, 3).
        theta: angle, (B,) [rad].

    Returns:
        R (B, 3, 3), a rotation where w has unit length, and p (B, 3), scene units.
    """
    W = vector_to_skew_symmetric_matrix(w)
    eye = torch.eye(3, dtype=w.dtype)
    t = theta[:, None, None]
    R = eye + t.sin() * W + (1 - t.cos()) * W @ W
    V = t * eye + (1 - t.cos()) * W + (t - t.sin()) * W @ W
    return R, (V @ v[..., None])[..., 0]


@SEARCHES.register("se3_jaws")
@dataclass(frozen=True)
class Se3Jaws:
    """v, w, theta, applied to the camera's pose from the left in the world, and p of the focal factor 0.5 p + 0.5.

    The motion is about the world's origin, not about the camera: a turn moves a camera that stands far away.

    Args:
        translation: half-range of v, scene units.
        unit_axis: w is normalised. The published code does not; its matrix is then no rotation, and what is taken
            here is the nearest one, because a camera is rigid.
    """

    dimensions: ClassVar[int] = 8
    needs_subject: ClassVar[bool] = False
    unbounded: ClassVar[slice] = slice(0, 7)  # a frame moves about the one before: x may stand anywhere, but the lens
    refinable: ClassVar[bool] = False  # without a turn the axis has no slope, and without an axis the turn has none

    translation: float = 5.0
    unit_axis: bool = True

    def __post_init__(self) -> None:
        if not self.translation > 0:
            raise ValueError(f"translation must be positive, got {self.translation}")

    def bounds(self) -> tuple[Tensor, Tensor]:
        """v in scene units, w in [-1, 1], theta in [-pi/2, pi/2], and p for focal factors from 0.25 to 3.5."""
        high = torch.tensor([*[self.translation] * 3, 1, 1, 1, math.pi / 2, 6.0], dtype=torch.float64)
        low = -high
        low[7] = -0.5
        return low, high

    def unit_note(self, subject: Subject) -> str:
        """What a step comes to in the unit of this scene, where that is far from a metre; else empty.

        ``translation`` bounds v alone: whoever steps along it goes by scene units.
        """
        heights = 1 / subject.height
        if SHORTEST <= heights <= LONGEST:
            return ""
        told = f"the camera moves by steps in scene units, each {heights:.3g} heights of the person"
        return f"{told}: se3_jaws is made for scenes in metres"

    def cameras(self, x: Tensor, home: Camera, subject: Subject | None) -> Camera:
        """B cameras of x (B, 8) or (B, 7): v, w, theta, p."""
        x = x.double()
        w = x[:, 3:6]
        if self.unit_axis:
            w = w / w.norm(dim=1, keepdim=True).clamp_min(1e-9)
        move = torch.eye(4, dtype=torch.float64).repeat(len(x), 1, 1)
        move[:, :3, :3], move[:, :3, 3] = exponential(x[:, :3], w, x[:, 6])
        if not self.unit_axis:
            left, _, right = torch.linalg.svd(move[:, :3, :3])
            move[:, :3, :3] = left @ right
        K = home.K.repeat(len(x), 1, 1)
        if x.shape[1] == self.dimensions:
            K[:, [0, 1], [0, 1]] = K[:, [0, 1], [0, 1]] * (0.5 * x[:, 7:] + 0.5)
        return Camera(inverse_transformation(move @ home.c2w), K, home.size)

    def vector(self, camera: Camera, home: Camera, subject: Subject | None) -> Tensor:
        """x (B, 8), with a w of unit length; a camera that is not turned but moved is turned a little."""
        move = camera.c2w @ home.w2c
        p = move[:, :3, 3]
        turn = rotation_matrix_to_axis_angle(move[:, :3, :3])
        angle = turn.norm(dim=1)
        w = turn / angle.clamp_min(1e-12)[:, None]
        theta = torch.where(p.norm(dim=1) > 0, angle.clamp_min(LEAST_TURN), angle)
        along = (w * p).sum(1, keepdim=True) * w
        across = torch.linalg.cross(w, p - along)
        # V on the plane across w is sin(theta) I + (1 - cos(theta)) [w], along w it is theta
        half = (theta / 2)[:, None]
        v = along / theta.clamp_min(1e-12)[:, None]
        v = v + ((p - along) * half.cos() - across * half.sin()) / (2 * half.sin()).clamp_min(1e-12)
        lens = 2 * camera.focal / home.focal - 1
        return torch.cat([v, w, theta[:, None], lens[:, None]], dim=1)

    def recentred(self, x: Tensor, home: Camera) -> tuple[Tensor, Camera]:
        """x (D,) and home for the same camera with v, w and theta at 0; the focal length stays that of home."""
        lens = x[7:].double()
        camera = self.cameras(x[None, :7], home, None)
        return torch.cat([torch.zeros(7, dtype=torch.float64), lens]), camera
