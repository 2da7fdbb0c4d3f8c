"""Pinhole cameras. Inside the project there is one convention; other programs' are converted here only.

OpenCV axes: x right, y down, z forward. ``w2c`` maps world to camera. Pixels have their corner at 0, so the
centre of the first pixel is 0.5 and ``x / W`` in [0, 1] is exact.
"""

from __future__ import annotations

import operator
from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Integral
from typing import SupportsIndex

import torch
from kornia.geometry.camera import project_points, unproject_points
from kornia.geometry.conversions import Rt_to_matrix4x4, camtoworld_vision_to_graphics_4x4
from kornia.geometry.linalg import inverse_transformation, transform_points
from torch import Tensor

from .orientation import unit

VIEW_LIMIT = 64  # views that are looked from, evenly taken, of a set or path that has more


@dataclass(frozen=True, eq=False)
class Camera:
    """B pinhole cameras that share one image size, on the CPU, whatever device they are made of.

    Args:
        w2c: world to camera, (B, 4, 4), kept as float64, rigid, OpenCV axes, scene units.
        K: intrinsics at ``size``, (B, 3, 3), kept as float64 [px].
        size: (W, H) [px].

    Raises:
        ValueError: a shape is wrong, or ``size`` is none.
        TypeError: ``w2c`` or ``K`` is no tensor.
    """

    w2c: Tensor  # (B, 4, 4)
    K: Tensor  # (B, 3, 3) [px]
    size: tuple[int, int]  # (W, H) [px]

    def __post_init__(self) -> None:
        for name, shape in (("w2c", (4, 4)), ("K", (3, 3))):
            value: object = getattr(self, name)
            wanted = f"(B, {shape[0]}, {shape[1]})"
            if not isinstance(value, Tensor):
                raise TypeError(
                    f"{name} must be a tensor {wanted}, got {type(value).__name__}; torch.as_tensor makes one"
                )
            got = tuple(value.shape)
            if len(got) != 3 or got[1:] != shape:
                raise ValueError(f"{name} must be {wanted}, got {got}; add a batch dimension")
        if len(self.w2c) != len(self.K):
            raise ValueError(f"w2c and K must have the same batch, got {len(self.w2c)} and {len(self.K)}")
        object.__setattr__(self, "w2c", self.w2c.to("cpu", torch.float64))
        object.__setattr__(self, "K", self.K.to("cpu", torch.float64))
        object.__setattr__(self, "size", frame_size(self.size))

    def __len__(self) -> int:
        return len(self.w2c)

    def __getitem__(self, index: SupportsIndex | slice | Sequence[int] | Tensor) -> Camera:
        """Cameras of ``index``; an integer keeps a batch of one."""
        rows = batch_index(index)
        several = [rows] if isinstance(rows, int) else rows.cpu() if isinstance(rows, Tensor) else rows
        return replace(self, w2c=self.w2c[several], K=self.K[several])

    @property
    def c2w(self) -> Tensor:
        """Camera to world, (B, 4, 4)."""
        return inverse_transformation(self.w2c)

    @property
    def center(self) -> Tensor:
        """Camera centres in the world, (B, 3), scene units."""
        return -(self.w2c[:, :3, :3].transpose(1, 2) @ self.w2c[:, :3, 3:])[..., 0]

    @property
    def focal(self) -> Tensor:
        """Vertical focal length, (B,) [px]."""
        return self.K[:, 1, 1]

    @property
    def vertical_fov(self) -> Tensor:
        """Vertical field of view, (B,) [rad]."""
        return 2 * torch.atan(self.size[1] / (2 * self.focal))

    def at_size(self, size: tuple[int, int]) -> Camera:
        """The same cameras on another pixel grid; a point keeps its place relative to the frame."""
        scale = self.K.new_tensor([size[0] / self.size[0], size[1] / self.size[1], 1.0])
        return replace(self, K=self.K * scale[:, None], size=size)

    def to_camera(self, points: Tensor) -> Tensor:
        """World points (P, 3) or (B, P, 3) in each camera's axes, (B, P, 3) float64 on the CPU, scene units."""
        if points.dim() == 2:
            points = points[None]
        batch = len(self) if len(points) == 1 else len(points)
        return transform_points(self.w2c.expand(batch, 4, 4), points.to(self.w2c).expand(batch, -1, 3))

    def project(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Pixels (B, P, 2) and depths (B, P) of world points (P, 3) or (B, P, 3).

        Depth is along the optical axis; where it is not positive the pixel means nothing.
        """
        inside = self.to_camera(points)
        pixels = project_points(inside, self.K[:, None].expand(len(inside), inside.shape[1], 3, 3))
        return pixels, inside[..., 2]

    def unproject(self, pixels: Tensor, depth: Tensor) -> Tensor:
        """World points (B, P, 3) of pixels (B, P, 2) at depths (B, P) along the optical axis."""
        K = self.K[:, None].expand(len(pixels), pixels.shape[1], 3, 3)
        inside = unproject_points(pixels.to(self.K), depth[..., None].to(self.K), K)
        return transform_points(self.c2w, inside)

    def to_opengl(self) -> Tensor:
        """Camera-to-world (B, 4, 4) with x right, y up, z backward (OpenGL, Blender, nerfstudio)."""
        return camtoworld_vision_to_graphics_4x4(self.c2w)

    @classmethod
    def look_at(
        cls, eye: Tensor, target: Tensor, up: Tensor, vertical_fov: float | Tensor, size: tuple[int, int]
    ) -> Camera:
        """Cameras at ``eye`` (B, 3) that see ``target`` (B, 3) in the middle, ``up`` (3,) upwards.

        ``vertical_fov`` [rad] is a number or (B,). One that looks along ``up``, or at where it stands, is NaN.
        """
        eye, target = torch.broadcast_tensors(eye.double(), target.double())
        forward = unit(target - eye)
        right = unit(torch.linalg.cross(forward, up.to(eye).expand_as(eye)))
        down = torch.linalg.cross(forward, right)
        rotation = torch.stack([right, down, forward], dim=1)
        fov = torch.as_tensor(vertical_fov, dtype=torch.float64, device=eye.device).expand(len(eye))
        return cls(w2c_of(rotation, eye), intrinsics(size[1] / (2 * torch.tan(fov / 2)), size), size)


def frame_size(size: object) -> tuple[int, int]:
    """(W, H) as plain numbers, which files hold, of whole ones of any kind, numpy's too.

    Raises:
        ValueError: it is none.
    """
    if isinstance(size, tuple) and len(size) == 2 and all(isinstance(n, Integral) and int(n) > 0 for n in size):
        return int(size[0]), int(size[1])
    raise ValueError(f"size must be (W, H), two whole numbers above 0, got {size!r}")


def w2c_of(R: Tensor, center: Tensor) -> Tensor:
    """World to camera, (B, 4, 4), of rotations (B, 3, 3) of that kind and centres in the world (B, 3)."""
    return Rt_to_matrix4x4(R, -(R @ center[..., None]))


def batch_index(index: SupportsIndex | slice | Sequence[int] | Tensor) -> int | slice | Tensor:
    """``index`` so that torch takes it along the first axis alone: an integer of any kind, or several of them."""
    if isinstance(index, slice) or (isinstance(index, Tensor) and index.dim() > 0):
        return index
    try:
        return operator.index(index)  # type: ignore[arg-type]  # a sequence has none
    except TypeError:
        several = list(index)  # type: ignore[arg-type]
        return torch.as_tensor(several, dtype=None if several else torch.long)


def intrinsics(focal: Tensor, size: tuple[int, int]) -> Tensor:
    """K (B, 3, 3) of square pixels with ``focal`` (B,) [px] and the principal point in the middle."""
    K = torch.eye(3, dtype=torch.float64, device=focal.device).repeat(len(focal), 1, 1)
    K[:, 0, 0] = K[:, 1, 1] = focal
    K[:, 0, 2], K[:, 1, 2] = size[0] / 2, size[1] / 2
    return K


def resized(camera: Camera, size: tuple[int, int]) -> Camera:
    """The same cameras with square pixels on a grid of nearly the same shape; the vertical field of view is kept."""
    return Camera(camera.w2c, intrinsics(camera.focal * size[1] / camera.size[1], size), size)


def concatenate(cameras: Sequence[Camera]) -> Camera:
    """One batch of several; all must share one size."""
    sizes = {camera.size for camera in cameras}
    if len(sizes) != 1:
        raise ValueError(f"cameras must share one size, got {sorted(sizes)}; use at_size first")
    return Camera(torch.cat([c.w2c for c in cameras]), torch.cat([c.K for c in cameras]), sizes.pop())


def fitted_size(size: tuple[int, int], side: int) -> tuple[int, int]:
    """(W, H) of the same shape whose longer side is ``side`` [px].

    >>> fitted_size((1920, 1080), 160)
    (160, 90)
    """
    scale = side / max(size)
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))


def evenly_taken(cameras: Camera, most: int) -> Camera:
    """Those of the cameras, at most ``most``, that lie evenly along them, the first and the last among them."""
    count = min(len(cameras), most)
    return cameras[torch.linspace(0, len(cameras) - 1, count).round().long()]


def in_one_frame(cameras: Sequence[Camera], sizes: Sequence[tuple[int, int]]) -> Camera:
    """One batch of several, each as large as its own one of ``sizes`` [px], in a frame that holds all of these.

    A view that is narrower or lower than the frame is in its middle, and sees what is beside it too.
    """
    frame = (max(width for width, _ in sizes), max(height for _, height in sizes))
    return concatenate([_padded(camera.at_size(size), frame) for camera, size in zip(cameras, sizes)])


def _padded(camera: Camera, frame: tuple[int, int]) -> Camera:
    """The same cameras, with as much more to see on either side as makes them ``frame`` [px] large."""
    K = camera.K.clone()
    K[:, :2, 2] += K.new_tensor([frame[0] - camera.size[0], frame[1] - camera.size[1]]) / 2
    return replace(camera, K=K, size=frame)
