"""3D Gaussian splats (Kerbl et al. 2023): numba kernels on the CPU, or the plain torch they are tested against."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import torch

from ..camera import Camera
from ..features import Features
from ..registry import RENDERERS
from ..scenes import Scene
from ..scenes.splats import Splats
from ..threads import thread_count
from . import _splats_torch
from ._request import check_request
from .kernels import splats as kernels


@RENDERERS.register("gaussian_splats")
@dataclass(frozen=True)
class GaussianSplats:
    """Renders :class:`~cltransfer.scenes.splats.Splats` over black.

    Args:
        backend: numba, or torch: slower by far, and differentiable in the cameras.
        antialiased: keep the energy of splats smaller than a pixel (Mip-Splatting); right for small frames.
        near: nothing nearer is drawn, scene units, > 0.
        near_fade: opacity grows from 0 to 1 over this distance behind ``near``, scene units, >= 0. Without it one
            Gaussian that crosses the near plane makes a loss jump.
        threads: at most so many cameras at once; 0 is what the process may use.

    Raises:
        ValueError: an option is out of range.
    """

    provides: ClassVar[frozenset[str]] = frozenset({"image", "alpha", "label", "depth", "expected_depth"})

    backend: Literal["numba", "torch"] = "numba"
    antialiased: bool = True
    near: float = 0.1
    near_fade: float = 0.3
    threads: int = 0

    def __post_init__(self) -> None:
        if not self.near > 0:
            raise ValueError(f"near must be positive, got {self.near}")
        if not self.near_fade >= 0:
            raise ValueError(f"near_fade must not be negative, got {self.near_fade}")
        if self.threads < 0:
            raise ValueError(f"threads must not be negative, got {self.threads}")

    def render(self, scene: Scene, cameras: Camera, buffers: frozenset[str]) -> Features:
        """Features of B cameras: ``buffers``, camera and person.

        Depth is the median along the ray, NaN where the scene covers less than half of the pixel; expected depth is
        NaN where it covers less than 1/1000. Colour costs about as much as all the rest: ask only for what is used.

        Raises:
            UsageError: the scene is not made of splats, or a buffer is unknown.
            ValueError: a camera is not finite or has skew.
        """
        check_request("gaussian_splats", scene, cameras, buffers, self.provides)
        draw = self._numba if self.backend == "numba" else self._torch
        drawn = draw(scene.geometry, cameras, buffers)
        return Features(cameras.size, **drawn, camera=cameras, person=scene.subject)

    @property
    def settings(self) -> kernels.Settings:
        """What the backends share."""
        return kernels.Settings(self.near, self.near_fade, self.antialiased)

    def _numba(self, splats: Splats, cameras: Camera, buffers: frozenset[str]) -> dict[str, Any]:
        matrices = zip(cameras.w2c.detach().cpu().numpy(), cameras.K.detach().cpu().numpy())
        views = [kernels.make_view(w2c, K, cameras.size, self.settings) for w2c, K in matrices]
        threads = self.threads or thread_count()
        out = kernels.render(splats.packed, views, "image" in buffers, threads)._asdict()
        return {name: torch.from_numpy(out[name]) for name in buffers}

    def _torch(self, splats: Splats, cameras: Camera, buffers: frozenset[str]) -> dict[str, Any]:
        # camera by camera: 150 ms each at 10k Gaussians and 160x90, so the loop itself costs nothing
        frames = [
            _splats_torch.render_one(splats, w2c, K, cameras.size, self.settings)
            for w2c, K in zip(cameras.w2c, cameras.K)
        ]
        return {name: torch.stack([frame[name] for frame in frames]) for name in buffers}
