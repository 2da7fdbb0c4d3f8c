"""What a geometry has: all that a scene's verbs ask of splats, grids, meshes and what a plugin reads."""

from __future__ import annotations

from typing import Any, ClassVar, Protocol

import torch
from torch import Tensor


class Geometry(Protocol):
    """N primitives of any kind (Gaussians, vertices, points on a surface) that one renderer draws.

    Who asks for what: ``transfer``, ``render`` and references for ``renderer``, ``label`` and N; finding the person
    (``lift``, or a transfer without ``--subject``) for ``means`` and ``with_label`` too, and for image and depth of its
    renderer; a person from a file for ``means``, that it lies where it is marked. A search asks the renderer for what
    its losses reach, the shipped ones label and depth, and its guard for depth. What only splats have is done to splats
    alone: ``floaters=drop`` leaves others as they are; ``lod``, ``simplify`` and ``bake`` refuse them.

    Tensors are on the CPU and without gradient. It is never changed, and told apart by identity: a dataclass is
    ``@dataclass(frozen=True, eq=False)``.
    """

    renderer: ClassVar[str]
    """Registered name of the renderer that draws it."""

    @property
    def means(self) -> Tensor:
        """Where the primitives are, (N, 3) floating point, finite, world, scene units.

        Where people are looked for follows from their median and reach; each is voted to be the person's or not by
        what views see at its place, so of a field without primitives these are places dense on its surfaces.
        """
        ...

    @property
    def label(self) -> Tensor:
        """Membership of each primitive in the subject, (N,) floating point in [0, 1]; 0 where nobody is marked yet.

        A voxel grid keeps it at all its vertices. The renderer's ``label`` buffer shows it.
        """
        ...

    def __len__(self) -> int:
        """N, at least 1: by it labels.safetensors of another scene are refused."""
        ...

    def with_label(self, label: Tensor) -> Geometry:
        """The same primitives with another membership (N,), any floating point."""
        ...


def lacking(geometry: Any, renderers: list[str]) -> str:
    """What a geometry that is not ours lacks to be one, in words; empty where it lacks nothing.

    Args:
        geometry: anything.
        renderers: names that are registered.
    """
    missing = [n for n in ("renderer", "means", "label", "__len__", "with_label") if not hasattr(geometry, n)]
    if missing:
        return f"{type(geometry).__name__} without {', '.join(missing)}"
    if geometry.renderer not in renderers:
        return f"renderer = {geometry.renderer!r}, which nobody has registered"
    count = len(geometry)
    if count == 0:
        return "no primitive"
    for name, shape in (("means", (count, 3)), ("label", (count,))):
        if found := _no_values(getattr(geometry, name), shape):
            return f"{name} {found}"
    if not bool(((geometry.label >= 0) & (geometry.label <= 1)).all()):
        return "label outside [0, 1]"
    return ""


def _no_values(value: Any, shape: tuple[int, ...]) -> str:
    """What ``value`` is instead of finite numbers of ``shape`` on the CPU, empty where it is as expected."""
    wanted = f"{shape} floating point on the CPU, without gradient, "
    if not isinstance(value, Tensor):
        return f"that is {type(value).__name__} and no tensor"
    if tuple(value.shape) != shape or not value.is_floating_point():
        return f"{tuple(value.shape)} {value.dtype}, not {wanted[:-2]}"
    if value.device.type != "cpu" or value.requires_grad:
        return f"on {value.device}{' with gradient' * value.requires_grad}, not {wanted[:-2]}"
    return "" if bool(torch.isfinite(value).all()) else "that is not finite"
