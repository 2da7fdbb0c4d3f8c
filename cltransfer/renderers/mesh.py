"""Triangle meshes: a z-buffer in numba, or the plain torch it is tested against."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal, cast

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, pixel_unshuffle

from ..camera import Camera
from ..features import Features
from ..registry import RENDERERS
from ..scenes import Scene
from ..scenes.mesh import Mesh as Triangles
from ..threads import thread_count
from . import _mesh_torch
from ._request import check_request
from .kernels import mesh as kernels


@RENDERERS.register("mesh")
@dataclass(frozen=True)
class Mesh:
    """Renders :class:`~cltransfer.scenes.mesh.Mesh` over black, faces from both sides.

    Args:
        backend: numba, or torch: slower by far, and readable.
        near: nothing nearer is drawn, scene units, > 0.
        samples: rays a pixel along each axis, 1 to 8; more smooth the edges and cost their square.
        headlight: share of the light on unpainted faces that comes from the camera, in [0, 1]; 0 shows them flat.
        threads: at most so many cameras at once; 0 is what the process may use.

    Raises:
        ValueError: an option is out of range.
    """

    provides: ClassVar[frozenset[str]] = frozenset({"image", "alpha", "label", "depth", "expected_depth"})

    backend: Literal["numba", "torch"] = "numba"
    near: float = 0.01
    samples: int = 1
    headlight: float = 0.6
    threads: int = 0

    def __post_init__(self) -> None:
        if not self.near > 0:
            raise ValueError(f"near must be positive, got {self.near}")
        if not 1 <= self.samples <= 8:
            raise ValueError(f"samples must be in [1, 8], got {self.samples}")
        if not 0 <= self.headlight <= 1:
            raise ValueError(f"headlight must be in [0, 1], got {self.headlight}")
        if self.threads < 0:
            raise ValueError(f"threads must not be negative, got {self.threads}")

    def render(self, scene: Scene, cameras: Camera, buffers: frozenset[str]) -> Features:
        """Features of B cameras: ``buffers``, camera and person.

        Depth is that of the middle ray of a pixel, NaN where fewer than half of its rays meet the scene; expected
        depth is their mean, NaN where none does. With one sample they are the same.

        Raises:
            UsageError: the scene is not a mesh, or a buffer is unknown.
            ValueError: a camera is not finite or has skew.
        """
        check_request("mesh", scene, cameras, buffers, self.provides)
        triangles = cast(Triangles, scene.geometry)
        width, height = cameras.size
        fine = cameras.at_size((width * self.samples, height * self.samples))
        draw = self._numba if self.backend == "numba" else self._torch
        face, depth, image = draw(triangles, fine, "image" in buffers)
        hit = face >= 0
        planes = {"alpha": hit.float(), "depth": depth, "expected_depth": depth, "image": image}
        if "label" in buffers:
            planes["label"] = torch.where(hit, triangles.label.float()[face.clamp(min=0).long()], 0)
        drawn: dict[str, Any] = {name: _pooled(name, planes[name], self.samples) for name in buffers}
        return Features(cameras.size, **drawn, camera=cameras, person=scene.subject)

    def _numba(self, mesh: Triangles, cameras: Camera, color: bool) -> tuple[Tensor, Tensor, Tensor]:
        K = cameras.K.detach().cpu().numpy()
        lens = np.stack([K[:, 0, 0], K[:, 1, 1], K[:, 0, 2], K[:, 1, 2]], axis=1)
        views = kernels.Views(cameras.w2c.detach().cpu().numpy(), lens, cameras.size)
        light = kernels.Light(self.near, self.headlight)
        seen = kernels.render(mesh.packed, views, light, color, self.threads or thread_count())
        depth = np.where(seen.face < 0, np.float32(np.nan), 1 / np.maximum(seen.inverse, np.float32(1e-30)))
        return torch.from_numpy(seen.face), torch.from_numpy(depth), torch.from_numpy(seen.image)

    def _torch(self, mesh: Triangles, cameras: Camera, color: bool) -> tuple[Tensor, Tensor, Tensor]:
        # camera by camera: 22 ms each at 100k faces and 160x90, so the loop itself costs nothing
        frames = [_mesh_torch.render_one(mesh, cameras[i], self.near, self.headlight) for i in range(len(cameras))]
        face, depth, image = (torch.stack(planes) for planes in zip(*frames))
        return face, depth, image if color else image[:, :0]


def _pooled(name: str, fine: Tensor, samples: int) -> Tensor:
    """One value a pixel, (B, ..., H, W), of samples x samples rays: their mean, or their median of those that hit."""
    if samples == 1:
        return fine
    if name == "image":
        return avg_pool2d(fine, samples)
    rays = pixel_unshuffle(fine[:, None], samples)  # (B, samples^2, H, W)
    if name == "expected_depth":
        return rays.nanmean(1)
    if name == "depth":
        covered = rays.isfinite().float().mean(1) >= 0.5
        return torch.where(covered, rays.nanmedian(1).values, torch.nan)
    return rays.mean(1)
