"""The paper's eight parameters around the initial view (Sec. 4.3)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import torch
from kornia.geometry.conversions import axis_angle_to_rotation_matrix, rotation_matrix_to_axis_angle
from kornia.geometry.linalg import inverse_transformation
from torch import Tensor

from ..camera import Camera
from ..registry import SEARCHES
from ..subject import Subject

SMALLEST, LARGEST = 0.3, 30.0  # half-range of v in subject heights, beyond which it is one of another unit


@SEARCHES.register("paper_box")
@dataclass(frozen=True)
class PaperBox:
    """Translation v, rotation axis w, rotation angle theta and focal factor gamma, each in its printed range.

    The camera moves by v along its initial axes and turns by theta about w, normalised: with a free w the paper's
    exponential map is no rotation. gamma is clamped above 0, where the paper's range would divide by zero.

    Args:
        translation: half-range of v, above 0, scene units.
        angle: half-range of theta, above 0 [rad].
        focal: highest gamma; the lowest is ``focal_floor``.
        focal_floor: lowest gamma.
    """

    dimensions: ClassVar[int] = 8
    names: ClassVar[tuple[str, ...]] = ("v", "v", "v", "w", "w", "w", "theta", "gamma")
    needs_subject: ClassVar[bool] = False
    unbounded: ClassVar[slice] = slice(3, 6)  # the length of the axis means nothing
    refinable: ClassVar[bool] = False  # without a turn the axis has no slope, and without an axis the turn has none

    translation: float = 5.0
    angle: float = math.pi / 2
    focal: float = 5.0
    focal_floor: float = 0.05

    def __post_init__(self) -> None:
        for name in ("translation", "angle"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        if not 0 < self.focal_floor < self.focal:
            raise ValueError(f"expected 0 < focal_floor < focal, got {self.focal_floor} and {self.focal}")

    def bounds(self) -> tuple[Tensor, Tensor]:
        """The printed box, scaled to [-1, 1]."""
        return torch.full((8,), -1.0, dtype=torch.float64), torch.ones(8, dtype=torch.float64)

    @property
    def lens(self) -> Tensor:
        """Direction (8,) along which the focal length changes: gamma."""
        return torch.eye(8, dtype=torch.float64)[7]

    def unit_note(self, subject: Subject) -> str:
        """What the box comes to in the unit of this scene, where that is far from a person's size; else empty."""
        heights = self.translation / subject.height
        if SMALLEST <= heights <= LARGEST:
            return ""
        told = f"the camera moves by at most {self.translation:g} scene units along each axis, {heights:.2g} heights"
        three = float(f"{3 * subject.height:.1g}")
        return f"{told} of the person: search.paper_box.translation={three:g} is about three, as 5 is in metres"

    def cameras(self, x: Tensor, home: Camera, subject: Subject | None) -> Camera:
        """B cameras of x (B, 8) or (B, 7): v, w, theta, gamma as shares of their half-ranges."""
        x = x.double()
        axis = x[:, 3:6] / x[:, 3:6].norm(dim=1, keepdim=True).clamp_min(1e-9)
        move = torch.eye(4, dtype=torch.float64).repeat(len(x), 1, 1)
        move[:, :3, :3] = axis_angle_to_rotation_matrix(axis * x[:, 6:7] * self.angle)
        move[:, :3, 3] = x[:, :3] * self.translation
        K = home.K.repeat(len(x), 1, 1)
        if x.shape[1] == self.dimensions:
            gamma = ((x[:, 7] + 1) / 2 * self.focal).clamp_min(self.focal_floor)
            K[:, [0, 1], [0, 1]] = K[:, [0, 1], [0, 1]] * gamma[:, None]
        return Camera(inverse_transformation(home.c2w @ move), K, home.size)

    def vector(self, camera: Camera, home: Camera, subject: Subject | None) -> Tensor:
        """x (B, 8); cameras outside the box give values outside [-1, 1]."""
        move = home.w2c @ camera.c2w
        turn = rotation_matrix_to_axis_angle(move[:, :3, :3])
        angle = turn.norm(dim=1, keepdim=True)
        axis = turn / angle.clamp_min(1e-12)
        gamma = camera.focal / home.focal
        lens = gamma[:, None] * 2 / self.focal - 1
        return torch.cat([move[:, :3, 3] / self.translation, axis, angle / self.angle, lens], dim=1)
