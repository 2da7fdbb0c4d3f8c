"""What every renderer of ours refuses, in the same words."""

from __future__ import annotations

from ..camera import Camera
from ..drawing import check_kind
from ..errors import UsageError
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
