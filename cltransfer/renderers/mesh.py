"""Triangle meshes: a z-buffer in numba, or the plain torch it is tested against."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
import torch

from ..camera import Camera
from ..computer.threads import thread_count
from ..features import Features
from ..registry import RENDERERS
from ..scenes import Scene
from ..scenes.meshes.mesh import Mesh
from . import _mesh_torch
from ._request import check_device, check_request, drawn_in_torch
from .kernels import mesh as kernels


@RENDERERS.register("mesh")
@dataclass(frozen=True)
class MeshRenderer:
    """Renders :class:`~cltransfer.scenes.meshes.mesh.Mesh` over black, faces from both sides.

    Args:
        backend: numba, or torch: slower by far, and readable.
        near: nothing nearer is drawn, scene units, > 0.
        samples: rays a pixel along each axis, 1 to 8; more smooth the edges and cost their square.
        headlight: share of the light on unpainted faces that comes from the camera, in [0, 1]; 0 shows them flat.
        device: cpu or cuda, where the torch backend works; what it draws comes back to the CPU.
        threads: at most so many cameras at once; 0 is what the process may use.

    Raises:
        ValueError: an option is out of range.
    """

    provides: ClassVar[frozenset[str]] = frozenset({"image", "alpha", "label", "depth", "expected_depth"})

    backend: Literal["numba", "torch"] = "numba"
    near: float = 0.01
    samples: int = 1
    headlight: float = 0.6
    device: Literal["cpu", "cuda"] = "cpu"
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
        check_device(self.backend, self.device)

    def render(self, scene: Scene, cameras: Camera, buffers: frozenset[str]) -> Features:
        """Features of B cameras: ``buffers``, camera and person.

        Depth is the median of a pixel's rays, NaN where fewer than half of them meet the scene; expected depth is
        their mean, NaN where none does. With one ray they are the same.

        Raises:
            UsageError: the scene is not a mesh, or a buffer is unknown.
            ValueError: there is no camera, or one is not finite or has skew.
        """
        check_request("mesh", scene, cameras, buffers, self.provides)
        draw = self._numba if self.backend == "numba" else self._torch
        drawn = draw(scene.geometry, cameras, buffers)
        return Features(cameras.size, **drawn, camera=cameras, person=scene.subject)

    @property
    def settings(self) -> kernels.Settings:
        """What the backends share."""
        return kernels.Settings(self.near, self.headlight, self.samples)

    def _numba(self, mesh: Mesh, cameras: Camera, buffers: frozenset[str]) -> dict[str, Any]:
        K = cameras.K.detach().cpu().numpy()
        lens = np.stack([K[:, 0, 0], K[:, 1, 1], K[:, 0, 2], K[:, 1, 2]], axis=1)
        views = kernels.Views(cameras.w2c.detach().cpu().numpy(), lens, cameras.size)
        threads = self.threads or thread_count()
        out = kernels.render(mesh.packed, views, self.settings, "image" in buffers, threads)._asdict()
        return {name: torch.from_numpy(out[name]) for name in buffers}

    def _torch(self, mesh: Mesh, cameras: Camera, buffers: frozenset[str]) -> dict[str, Any]:
        return drawn_in_torch(self, _mesh_torch.render_one, mesh, cameras, buffers)
