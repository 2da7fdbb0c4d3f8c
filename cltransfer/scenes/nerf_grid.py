"""Radiance fields on a regular grid as a value, and as a safetensors file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from ..computer.memory import require_free
from ..errors import InputError
from ..renderers.kernels.grid_pack import Packed, pack
from ..storage.tensor_file import check_tensor_file, save_tensors

FORMAT = "cltransfer.nerf_grid.1"
LIMIT = 4 * 2**30  # bytes
MOST_VERTICES = 518**3  # 512 cells a side, the most that `bake` takes, with its margin: 2.6 GiB without directions
MOST_STEPS = 100_000  # of the smallest side of a voxel along the box's diagonal: a ray may have twice as many
SH_DEGREES = {1: 0, 4: 1, 9: 2}  # coefficients per channel -> degree
KEYS = ("density", "sh", "label", "aabb")
_BYTES = {"F16": 2, "F32": 4, "F64": 8}  # of a stored number
_KEPT = {"density": torch.float32, "sh": torch.float32, "label": torch.float32, "aabb": torch.float64}
_LOOKED_AT = 3  # bytes that looking at a density or a label takes
_PLACE = 60  # bytes that the place of a vertex takes while it is made of its index
_BLOCK = 2**20  # numbers that are looked at together for being finite


@dataclass(frozen=True, eq=False)
class NerfGrid:
    """Density and view-dependent colour at the vertices of a box's grid, trilinear in between, nothing outside.

    Vertex 0 of an axis lies on the box's lower side and the last one on its upper side.

    Args:
        density: extinction, >= 0, per scene unit, (Z, Y, X), each side >= 2.
        sh: real spherical harmonics of the colour minus 0.5, (Z, Y, X, (d + 1)^2, 3), degree d in 0..2.
        label: membership in the subject, [0, 1], (Z, Y, X).
        aabb: lower and upper corner of the box in the world, (2, 3) float64 as x, y, z, scene units.

    Raises:
        ValueError: a shape is wrong, or the box is empty.
    """

    renderer: ClassVar[str] = "nerf_grid"

    density: Tensor  # (Z, Y, X) [1 / scene unit]
    sh: Tensor  # (Z, Y, X, (d + 1)^2, 3)
    label: Tensor  # (Z, Y, X)
    aabb: Tensor  # (2, 3)

    def __post_init__(self) -> None:
        shape = tuple(self.density.shape)
        if len(shape) != 3 or min(shape) < 2:
            raise ValueError(f"density must be (Z, Y, X) with sides of at least 2, got {shape}")
        got = tuple(self.sh.shape)
        if got[:3] != shape or len(got) != 5 or got[3] not in SH_DEGREES or got[4] != 3:
            raise ValueError(f"sh must be {(*shape, '1 | 4 | 9', 3)}, got {got}")
        if tuple(self.label.shape) != shape:
            raise ValueError(f"label must be {shape}, got {tuple(self.label.shape)}")
        if tuple(self.aabb.shape) != (2, 3) or not bool((self.aabb[1] > self.aabb[0]).all()):
            raise ValueError(f"aabb must be a lower and a greater upper corner, got {self.aabb.tolist()}")

    @property
    def degree(self) -> int:
        """Degree of the spherical harmonics, 0..2."""
        return SH_DEGREES[self.sh.shape[3]]

    @property
    def voxel(self) -> Tensor:
        """Distance between neighbouring vertices along x, y, z, (3,), scene units."""
        counts = self.aabb.new_tensor(self.density.shape[::-1])
        return (self.aabb[1] - self.aabb[0]) / (counts - 1)

    @cached_property
    def filled(self) -> Tensor:
        """Indices z, y, x of the N vertices that hold anything, (N, 3); these are what labels are about."""
        return torch.nonzero(self.density > 0)

    def __len__(self) -> int:
        return len(self.filled)

    @property
    def means(self) -> Tensor:
        """Places of the vertices that hold anything, (N, 3), scene units."""
        axes = zip(self.aabb[0], self.filled.unbind(1)[::-1], self.voxel)  # one by one: together they take much more
        return torch.stack([(low + index * side).float() for low, index, side in axes], dim=1)

    def with_label(self, label: Tensor) -> NerfGrid:
        """The same field with another subject membership (N,) in [0, 1] of the vertices that hold anything."""
        whole = torch.zeros_like(self.label)
        whole[tuple(self.filled.T)] = label.to(whole)
        return replace(self, label=whole)

    @cached_property
    def packed(self) -> Packed:
        """Layout of the CPU kernels, made on first use; it shares memory with a float32 grid."""
        density, sh, label = (
            p.detach().to("cpu", torch.float32).contiguous().numpy() for p in (self.density, self.sh, self.label)
        )
        return pack(density, sh, label, self.aabb.detach().cpu().double().numpy())


def write_grid(path: Path, grid: NerfGrid) -> None:
    """Write ``grid`` as safetensors, whole or not at all."""
    save_tensors(path, {key: getattr(grid, key).contiguous() for key in KEYS}, {"format": FORMAT})


def read_grid(path: Path) -> NerfGrid:
    """Read a grid that :func:`write_grid` wrote, or any safetensors with its four tensors and format name.

    Raises:
        InputError: it is missing, too large, of another format, a tensor is missing or of a wrong shape, density is
            negative, label is outside [0, 1], a value is not finite, or the box is so flat that no ray would end.
        ResourceError: it takes more memory than is free.
    """
    from safetensors import SafetensorError, safe_open

    check_tensor_file(path, LIMIT, "grid in safetensors")
    try:
        with safe_open(path, framework="pt") as stream:
            _check_header(path, stream)
            tensors = {key: stream.get_tensor(key).to(_KEPT[key], copy=True) for key in KEYS}
    except SafetensorError as error:
        raise InputError(path, "", f"not a grid in safetensors: {error}") from None
    _check_values(path, tensors)
    try:
        grid = NerfGrid(**tensors)
    except ValueError as error:
        key, _, reason = str(error).partition(" must be ")
        raise InputError(path, key, f"expected {reason}") from None
    _check_voxel(path, grid)
    filled = int(grid.density.count_nonzero())
    require_free(_PLACE * filled, path, f"places of {filled} vertices", "store it with fewer vertices")
    return grid


def _check_header(path: Path, stream: Any) -> None:
    """Format, names, types and sizes, before anything is allocated."""
    named = (stream.metadata() or {}).get("format")
    if named != FORMAT:
        raise InputError(path, "format", f"expected {FORMAT!r}, got {named!r}")
    sizes: dict[str, tuple[int, int]] = {}  # how many numbers, and bytes of each
    for key in KEYS:
        if key not in stream.keys():  # noqa: SIM118  (the stream is no mapping)
            raise InputError(path, key, "tensor is missing")
        part = stream.get_slice(key)
        if part.get_dtype() not in _BYTES:
            raise InputError(path, key, f"expected floating point, got {part.get_dtype()}")
        sizes[key] = int(np.prod(part.get_shape(), dtype=object)), _BYTES[part.get_dtype()]
    vertices = sizes["density"][0]
    if vertices > MOST_VERTICES:
        raise InputError(path, "density", f"expected at most {MOST_VERTICES} vertices, got {vertices}")
    require_free(_need(sizes), path, "its tensors", "store it with fewer vertices")


def _need(sizes: Mapping[str, tuple[int, int]]) -> int:
    """Bytes that tensors of so many numbers of so many bytes take at the peak.

    Those that are of another precision are brought to the one in which they are kept; then all are looked at.
    """
    stored = sum(count * size for count, size in sizes.values())
    kept = {key: count * _KEPT[key].itemsize for key, (count, size) in sizes.items() if size != _KEPT[key].itemsize}
    return stored + sum(kept.values()) + _LOOKED_AT * max(sizes[key][0] for key in ("density", "label"))


def _check_values(path: Path, tensors: dict[str, Tensor]) -> None:
    for key, value in tensors.items():
        if not all(bool(part.isfinite().all()) for part in value.flatten().split(_BLOCK)):
            raise InputError(path, key, "expected finite values, got NaN or infinity")
    if bool((tensors["density"] < 0).any()):
        raise InputError(path, "density", f"expected no negative value, got {float(tensors['density'].min()):g}")
    if not bool((tensors["density"] > 0).any()):
        raise InputError(path, "density", "holds nothing, all is 0")
    if bool(((tensors["label"] < 0) | (tensors["label"] > 1)).any()):
        raise InputError(path, "label", "expected values in [0, 1]")


def _check_voxel(path: Path, grid: NerfGrid) -> None:
    """Refuse a box that takes too many steps to cross, which go by the smallest side of a voxel."""
    steps = float((grid.aabb[1] - grid.aabb[0]).norm() / grid.voxel.min())
    if not steps <= MOST_STEPS:
        reason = f"expected at most {MOST_STEPS} times a voxel's smallest side along its diagonal, got {steps:.3g}"
        raise InputError(path, "aabb", reason, "give the box more depth, or fewer vertices there")
