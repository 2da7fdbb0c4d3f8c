"""3D Gaussian splats (Kerbl et al. 2023): numba on the CPU, gsplat on CUDA, or the plain torch they are tested on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import torch

from ..camera import Camera
from ..computer.cuda import on_device, require_gsplat
from ..computer.threads import thread_count
from ..features import Features
from ..registry import RENDERERS
from ..scenes import Scene
from ..scenes.splats import Splats
from . import _splats_gsplat, _splats_torch
from ._request import check_device, check_request, drawn_in_torch
from .kernels import splats as kernels


@RENDERERS.register("gaussian_splats")
@dataclass(frozen=True)
class GaussianSplats:
    """Renders :class:`~cltransfer.scenes.splats.Splats` over black.

    Args:
        backend: numba; gsplat, which needs a CUDA device and the extra [cuda]; or torch: slower by far, and
            differentiable in the cameras.
        antialiased: keep the energy of splats smaller than a pixel (Mip-Splatting); right for small frames. False is
            right for a film near the training size of a scene that was trained without it, as most are: by 3DGS,
            nerfstudio and gsplat unless they are told otherwise.
        near: nothing nearer is drawn, scene units, > 0.
        near_fade: opacity grows from 0 to 1 over this distance behind ``near``, scene units, >= 0. Without it one
            Gaussian that crosses the near plane makes a loss jump.
        device: cpu or cuda, where the torch backend works; what it draws comes back to the CPU.
        threads: of numba, at most so many cameras at once; 0 is what the process may use.

    Raises:
        ValueError: an option is out of range.
    """

    provides: ClassVar[frozenset[str]] = frozenset({"image", "alpha", "label", "depth", "expected_depth"})

    backend: Literal["numba", "torch", "gsplat"] = "numba"
    antialiased: bool = True
    near: float = 0.1
    near_fade: float = 0.3
    device: Literal["cpu", "cuda"] = "cpu"
    threads: int = 0

    def __post_init__(self) -> None:
        if not self.near > 0:
            raise ValueError(f"near must be positive, got {self.near}")
        if not self.near_fade >= 0:
            raise ValueError(f"near_fade must not be negative, got {self.near_fade}")
        if self.threads < 0:
            raise ValueError(f"threads must not be negative, got {self.threads}")
        check_device(self.backend, self.device)

    def render(self, scene: Scene, cameras: Camera, buffers: frozenset[str]) -> Features:
        """Features of B cameras: ``buffers``, camera and person.

        Depth is the median along the ray, NaN where the scene covers less than half of the pixel; expected depth is
        NaN where it covers less than 1/1000. Colour costs about as much as all the rest: ask only for what is used.

        Raises:
            UsageError: the scene is not made of splats, or a buffer is unknown.
            ModelError: the backend or the device is not on this computer.
            ValueError: there is no camera, or one is not finite or has skew.
        """
        check_request("gaussian_splats", scene, cameras, buffers, self.provides)
        draw = {"numba": self._numba, "torch": self._torch, "gsplat": self._gsplat}[self.backend]
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

    def require_backend(self) -> None:
        """Refuse a backend that is not on this computer.

        Raises:
            ModelError: it is not.
        """
        if self.backend == "gsplat":
            require_gsplat("renderer gaussian_splats", "backend=numba")

    def _gsplat(self, splats: Splats, cameras: Camera, buffers: frozenset[str]) -> dict[str, Any]:
        self.require_backend()
        if len(splats) == 0:  # gsplat refuses them
            return self._torch(splats, cameras, buffers)
        drawn = _splats_gsplat.render(on_device(splats, "cuda"), cameras, self.settings, buffers)
        return {name: drawn[name].cpu() for name in buffers}

    def _torch(self, splats: Splats, cameras: Camera, buffers: frozenset[str]) -> dict[str, Any]:
        return drawn_in_torch(self, _splats_torch.render_one, splats, cameras, buffers)
