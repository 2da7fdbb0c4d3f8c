"""Having a scene drawn by whatever renderer there is: ours or anybody's, of the config or of the scene itself."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from .camera import Camera
from .computer.memory import LITTLE, require_free
from .errors import ModelError, UsageError, named
from .features import Features
from .registry import RENDERERS

if TYPE_CHECKING:
    from .scenes import Scene

MAPS = frozenset({"image", "alpha", "label", "depth", "expected_depth"})  # (B, H, W), image (B, 3, H, W)
BESIDE = 1e-3  # of 1, that rounding may leave coverage and colour beside their range


OURS = ("gaussian_splats", "nerf_grid", "mesh")


def check_renderer(renderer: Any, scene: Scene) -> None:
    """Whether ``renderer`` draws ``scene`` and what it draws by is there, as far as it says: before anything else.

    Raises:
        UsageError: it draws another kind of scene.
        ModelError: its backend or device is not on this computer.
    """
    name = RENDERERS.name_of(renderer) or type(renderer).__name__
    if name in OURS or hasattr(renderer, "draws"):
        check_kind(name, scene, (name, *getattr(renderer, "draws", ())))
    if hasattr(renderer, "require_backend"):
        with named(f"renderer {name}", "expected nothing, or a ModelError"):
            renderer.require_backend()


def drawn_by(renderer: Any, scene: Scene, cameras: Camera, buffers: frozenset[str]) -> Features:
    """What ``renderer``, which may be anybody's, draws of ``scene`` into ``buffers``, with who looks and who is there.

    No gradient goes back through it: views are remembered, and each would hold all that it was made of.

    Raises:
        UsageError: it says what it draws, and that is another kind of scene.
        ModelError: it raised something of its own, or did not give that; the line names it.
        ResourceError: there is no memory for the frames.
    """
    _require_memory(scene, cameras, buffers)
    name = RENDERERS.name_of(renderer) or type(renderer).__name__
    if hasattr(renderer, "draws"):
        check_kind(name, scene, (name, *renderer.draws))
    who = f"renderer {name}"
    expected = f"expected {', '.join(sorted(buffers)) or 'features'}"
    with named(who, expected), torch.no_grad():
        drawn = renderer.render(scene, cameras, buffers)
    if not isinstance(drawn, Features):
        raise ModelError("", who, f"{expected}, got {type(drawn).__name__}", "return Features from render")
    if lacking := [name for name in sorted(buffers) if not drawn.has(name)]:
        raise ModelError("", who, f"{expected}, got no {', '.join(lacking)}")
    beside = ("camera",) if scene.subject is None else ("camera", "person")
    if lacking := [name for name in beside if not drawn.has(name)]:
        hint = "return Features(..., camera=cameras, person=scene.subject)"
        raise ModelError("", who, f"expected {' and '.join(beside)} beside the buffers, got no {lacking[0]}", hint)
    _check_frames(who, drawn, cameras, buffers)
    return drawn


def renderer_of(scene: Scene, configured: Any) -> Any:
    """What draws a scene that the config is not about, as the one a reference was shot in.

    It is ``configured``, unless that draws another geometry: one of ours, a plugin's that reads scene files of its own,
    or one that says what it draws. Then it is the one of ours that draws it, and of what a plugin has read that
    plugin's; with its defaults.
    """
    kind = getattr(scene.geometry, "renderer", "")
    name = RENDERERS.name_of(configured)
    if not kind or kind in (name, *getattr(configured, "draws", ())):
        return configured
    bound = name in OURS or hasattr(configured, "suffixes") or hasattr(configured, "draws")
    if kind in OURS:
        return RENDERERS.build(kind) if bound else configured
    return RENDERERS.build(kind) if kind in RENDERERS.registered() else configured


def check_kind(name: str, scene: Scene, draws: Sequence[str]) -> None:
    """Whether renderer ``name``, which draws scenes of those that ``draws`` names, draws this one."""
    kind = getattr(scene.geometry, "renderer", "")
    if kind not in draws:
        hint = f"choose: renderer.{kind}={{}}" if kind else ""
        raise UsageError(scene.name, f"renderer {name}", f"does not draw {type(scene.geometry).__name__}", hint)


def _require_memory(scene: Scene, cameras: Camera, buffers: frozenset[str]) -> None:
    """Refuse frames that there is no memory for, as float32; what else a renderer needs is its own to ask for."""
    (width, height), planes = cameras.size, sum(3 if name == "image" else 1 for name in buffers & MAPS)
    need = 4 * planes * len(cameras) * width * height
    if need > LITTLE:
        require_free(
            need, scene.name, f"the pixels of {_counted(len(cameras), cameras.size)}", "draw fewer, or smaller ones"
        )


def _check_frames(who: str, drawn: Features, cameras: Camera, buffers: frozenset[str]) -> None:
    """Whether a renderer has ``drawn`` a frame for each of ``cameras``, of their size, and says so.

    Raises:
        ModelError: it has not.
    """
    if not isinstance(drawn.camera, Camera):
        reason = f"expected the cameras that it was given, got {type(drawn.camera).__name__}"
        raise ModelError("", who, reason, "return Features(..., camera=cameras)")
    wanted, hint = _counted(len(cameras), cameras.size), "draw every camera, at cameras.size, and return camera=cameras"
    for size in (drawn.size, drawn.camera.size):
        if (came := _counted(len(drawn), size)) != wanted:
            raise ModelError("", who, f"expected {wanted}, got {came}", hint)
    for name in sorted(buffers & MAPS):
        value, size = drawn.require(name), cameras.size
        shape, got = (len(cameras), *([3] * (name == "image")), size[1], size[0]), tuple(value.shape)
        if got != shape:
            raise ModelError("", who, f"expected {name} of shape {shape}, got {got}", hint)
        if value.device.type != "cpu":
            raise ModelError("", who, f"expected {name} on the CPU, got {value.device}", f"return {name}.cpu()")
        if not value.is_floating_point():
            reason = f"expected {name} in floating point, got {value.dtype}"
            raise ModelError("", who, reason, f"return {name}.float()")
        if value.numel():
            _check_values(who, name, value.detach())


def _check_values(who: str, name: str, value: Tensor) -> None:
    """Whether coverage and colour are parts of one and a depth lies in front of the camera, NaN where nothing is.

    Raises:
        ModelError: they are not.
    """
    if name in ("depth", "expected_depth"):  # 0.1 ms a frame of 640x360, an image 0.3 ms
        if float(value.nan_to_num(nan=1.0, posinf=0.0).min()) <= 0:
            came = float(value[(value <= 0) | value.isinf()].flatten()[0])
            raise ModelError("", who, f"expected {name} above 0, and NaN where nothing is, got {came:g}")
        return
    low, high = (float(end) for end in value.aminmax())
    if math.isnan(low):
        raise ModelError("", who, f"expected {name} in [0, 1], got NaN", "0 where nothing is")
    if low < -BESIDE or high > 1 + BESIDE:
        reason = f"expected {name} in [0, 1], got {low:g} to {high:g}"
        raise ModelError("", who, reason, f"return {name}.clamp(0, 1), or {name} / 255 of bytes")


def _counted(count: int, size: tuple[int, int]) -> str:
    return f"{count} frame{'s' * (count != 1)} of {size[0]}x{size[1]}"
