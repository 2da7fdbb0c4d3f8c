"""Radiance fields on a voxel grid: numba kernels on the CPU, or the plain torch they are tested against."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import torch

from ..camera import Camera
from ..computer.threads import thread_count
from ..features import Features
from ..registry import RENDERERS
from ..scenes import Scene
from ..scenes.nerf_grid import NerfGrid
from . import _nerf_grid_torch
from ._request import check_device, check_request, drawn_in_torch
from .kernels import grids as kernels


@RENDERERS.register("nerf_grid")
@dataclass(frozen=True)
class NerfGridRenderer:
    """Renders :class:`~cltransfer.scenes.nerf_grid.NerfGrid` over black.

    Matter is cut off smoothly by the near plane, so there is no near fade.

    Args:
        backend: numba, or torch: slower by far, and differentiable in the cameras and the grid.
        step: longest step of a ray as a fraction of the smallest voxel edge, in (0, 1].
        near: nothing nearer is drawn, scene units, > 0.
        device: cpu or cuda, where the torch backend works; what it draws comes back to the CPU.
        threads: at most so many cameras at once; 0 is what the process may use.

    Raises:
        ValueError: an option is out of range.
    """

    provides: ClassVar[frozenset[str]] = frozenset({"image", "alpha", "label", "depth", "expected_depth"})

    backend: Literal["numba", "torch"] = "numba"
    step: float = 0.5
    near: float = 0.1
    device: Literal["cpu", "cuda"] = "cpu"
    threads: int = 0

    def __post_init__(self) -> None:
        if not 0 < self.step <= 1:
            raise ValueError(f"step must be in (0, 1], got {self.step}")
        if not self.near > 0:
            raise ValueError(f"near must be positive, got {self.near}")
        if self.threads < 0:
            raise ValueError(f"threads must not be negative, got {self.threads}")
        check_device(self.backend, self.device)

    def render(self, scene: Scene, cameras: Camera, buffers: frozenset[str]) -> Features:
        """Features of B cameras: ``buffers``, camera and person.

        Depth is the median along the ray, NaN where the scene covers less than half of the pixel; expected depth is
        NaN where it covers less than 1/1000.

        Raises:
            UsageError: the scene is no voxel grid, or a buffer is unknown.
            ValueError: there is no camera, or one is not finite or has skew.
        """
        check_request("nerf_grid", scene, cameras, buffers, self.provides)
        draw = self._numba if self.backend == "numba" else self._torch
        drawn = draw(scene.geometry, cameras, buffers)
        return Features(cameras.size, **drawn, camera=cameras, person=scene.subject)

    @property
    def settings(self) -> kernels.Settings:
        """What the backends share."""
        return kernels.Settings(self.near, self.step)

    def _numba(self, grid: NerfGrid, cameras: Camera, buffers: frozenset[str]) -> dict[str, Any]:
        packed = grid.packed
        matrices = zip(cameras.w2c.detach().cpu().numpy(), cameras.K.detach().cpu().numpy())
        views = [kernels.make_view(packed, w2c, K, cameras.size, self.settings) for w2c, K in matrices]
        out = kernels.render(packed, views, buffers, self.threads or thread_count())._asdict()
        return {name: torch.from_numpy(out[name]) for name in buffers}

    def _torch(self, grid: NerfGrid, cameras: Camera, buffers: frozenset[str]) -> dict[str, Any]:
        return drawn_in_torch(self, _nerf_grid_torch.render_one, grid, cameras, buffers)
