"""What every renderer of ours does alike: what it refuses, in the same words, and how its torch twin is asked."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from ..camera import Camera
from ..computer.cuda import on_device, require_cuda
from ..drawing import check_kind
from ..errors import UsageError
from ..registry import RENDERERS
from ..scenes import Scene


def check_request(name: str, scene: Scene, cameras: Camera, buffers: frozenset[str], provides: frozenset[str]) -> None:
    """Whether renderer ``name`` draws this scene, from these cameras, into these buffers.

    Raises:
        UsageError: the scene holds another geometry (the line names its renderer), or a buffer is unknown.
        ValueError: there is no camera, or one is not finite or has skew.
    """
    check_kind(name, scene, (name,))
    if unknown := buffers - provides:
        raise UsageError("", f"renderer {name}", f"has no buffer {', '.join(sorted(unknown))}")
    if len(cameras) == 0:
        raise ValueError("expected one camera or more, got none")
    if not (cameras.w2c.isfinite().all() and cameras.K.isfinite().all()):
        raise ValueError("cameras must be finite")
    if not bool((cameras.K[:, [0, 1], [0, 1]] > 0).all()):
        raise ValueError("cameras must have a positive focal length")
    if cameras.K[:, 0, 1].any():
        raise ValueError("cameras must have no skew: K[0, 1] is not 0")


def check_device(backend: str, device: str) -> None:
    """Whether ``backend`` can work on ``device``.

    Raises:
        ValueError: only torch works on the device one names: numba is for the CPU, gsplat for CUDA.
    """
    if device != "cpu" and backend != "torch":
        raise ValueError(f"device {device} needs backend torch, got {backend}")


def drawn_in_torch(
    renderer: Any, render_one: Callable[..., dict[str, Tensor]], geometry: Any, cameras: Camera, buffers: frozenset[str]
) -> dict[str, Tensor]:
    """``buffers`` of B cameras on the CPU, by the twin of a renderer on the device that it names.

    Camera by camera: each takes from 20 ms to half a second at 160x90, so the loop itself costs nothing.

    Raises:
        ModelError: the device is not on this computer.
    """
    if renderer.device == "cuda":
        require_cuda(f"renderer {RENDERERS.name_of(renderer)}", "device=cpu")
    geometry = on_device(geometry, renderer.device)
    frames = [render_one(geometry, cameras[i], renderer.settings) for i in range(len(cameras))]
    return {name: torch.stack([frame[name] for frame in frames]).cpu() for name in buffers}
