"""Splats no finer than they are seen: merged by distance, and rid of what contributes nothing.

What is smaller than a pixel is still projected, sorted and blended one by one; merging what falls together costs a
little sharpness and saves most of that (distance level of detail).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch
from kornia.geometry.conversions import rotation_matrix_to_quaternion
from torch import Tensor

from ..camera import Camera
from ..computer.array_type import Array
from ..computer.memory import require_free
from ..errors import UsageError
from ..near_plane import near_plane
from ..renderers.kernels.splat_pack import packing_order
from ..renderers.kernels.splats import Settings, View, make_view, weights
from . import Scene
from .splats import Splats

MAX_ALPHA = 0.99  # of a merged Gaussian, as renderers cut it off
LEVELS = 128  # voxel sizes 2^-128 to 2^127
CELL_BITS = 18  # of a cell's index along one axis
FINEST = 2.0 ** (1 - CELL_BITS)  # smallest voxel, as a share of the distance to the origin of the cells
MIN_VARIANCE = 1e-18  # squared scene units
PARTS = ("means", "scales", "quats", "opacity", "sh", "label")
STACKED = 0.3  # 0: voxels' members lie side by side, holes open; 1: all in one place, outlines grow
STEPS = 32  # of the integral of a stack's coverage
WHOLE = (0.1, 0.001)  # of the median depth in a view: two distances from which on Gaussians are weighed whole
SAMPLE = 10**5  # Gaussians that tell that depth
MEMBER, PILE = 450, 700  # bytes that one of several Gaussians takes while they are merged, and what they become


def merged(splats: Splats, cameras: Camera, k: float) -> Splats:
    """Splats as few as ``cameras`` can tell apart: one for all that share a voxel of ``k`` pixels.

    A voxel is k pixels large as the nearest camera sees it, rounded down to a power of two. Gaussians larger than
    their voxel stay as they are, and so do those alone in theirs; subject and surroundings never share one. What
    replaces several has their mean and covariance (weighted by opacity times area), their mean colour, and their
    optical depth -log(1 - opacity) times area. What nobody sees, of opacity 0, is left out. The result is a function
    of the arguments alone.

    Args:
        splats: N Gaussians.
        cameras: B views at the size they are rendered at.
        k: voxel size in pixels, > 0.

    Returns:
        At most N Gaussians.

    Raises:
        ValueError: ``k`` is not positive.
        ResourceError: there is not enough memory to merge them.
    """
    if not k > 0:
        raise ValueError(f"k must be positive, got {k}")
    seen = splats.opacity > 0
    if not bool(seen.all()):
        splats = subset(splats, seen)
    keys = _cells(splats, cameras, k)
    order = np.argsort(keys, kind="stable")
    starts = np.flatnonzero(np.diff(keys[order], prepend=-1))
    counts = np.diff(starts, append=len(order))
    alone = torch.from_numpy(np.sort(order[starts[counts == 1]]))
    shared = order[np.repeat(counts > 1, counts)]
    if len(shared) == 0:
        return splats
    need = sum(getattr(splats, name).nbytes for name in PARTS) + MEMBER * len(shared) + PILE * int((counts > 1).sum())
    require_free(need, "", f"{len(shared)} Gaussians that are to be merged", "take a smaller k or lod")
    return joined(subset(splats, alone), _moments(subset(splats, torch.from_numpy(shared)), counts[counts > 1]))


def pixel_width(points: Tensor, cameras: Camera) -> Tensor:
    """How wide a pixel of the camera that sees a point finest is there, (N,), scene units, of points (N, 3).

    Of a pixel that is not square it is the shorter side.
    """
    widths = torch.full((len(points),), torch.inf, dtype=torch.float64)
    for center, focal in zip(cameras.center, cameras.K[:, [0, 1], [0, 1]].amax(1)):  # 4 ms each for 500k points
        widths = torch.minimum(widths, (points.double() - center).norm(dim=1) / focal)
    return widths


def _cells(splats: Splats, cameras: Camera, k: float) -> Array:
    """Which voxel each Gaussian falls in, (N,) int64; one of its own, where it is larger than the voxel."""
    offset = splats.means.double() - cameras.center.mean(0)
    voxel = torch.maximum(k * pixel_width(splats.means, cameras), FINEST * offset.norm(dim=1))
    level = voxel.log2().floor().clamp(-LEVELS, LEVELS - 1)
    voxel = level.exp2()
    cell = (offset / voxel[:, None]).floor().long() + 2 ** (CELL_BITS - 1)
    key = (level.long() + LEVELS) * 2 + (splats.label > 0.5)
    for axis in range(3):
        key = (key << CELL_BITS) + cell[:, axis].clamp(0, 2**CELL_BITS - 1)
    large = splats.scales.amax(1) > voxel
    return torch.where(large, torch.iinfo(torch.int64).max - torch.arange(len(key)), key).numpy()


def _moments(member: Splats, counts: Array) -> Splats:
    """One Gaussian for each run of ``counts`` neighbours in ``member``."""
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    area = face_area(member.scales.double())
    opacity = member.opacity.double().clamp(max=MAX_ALPHA)
    weight = (opacity * area).clamp_min(1e-30).numpy()
    share = weight / np.repeat(np.add.reduceat(weight, starts), counts)

    def mean(values: Tensor) -> Tensor:
        columns = values.reshape(len(share), -1).unbind(1)  # one by one: all harmonics as doubles take too much memory
        means = [np.add.reduceat(column.double().numpy() * share, starts) for column in columns]
        return torch.from_numpy(np.stack(means, axis=1)).reshape(-1, *values.shape[1:])

    center = mean(member.means)
    spread = member.means.double() - center.repeat_interleave(torch.from_numpy(counts), dim=0)
    variance, axes = torch.linalg.eigh(mean(member.covariances().double() + spread[:, :, None] * spread[:, None, :]))
    axes[:, :, 0] *= torch.linalg.det(axes)[:, None]  # a rotation, not a mirror
    scales = variance.clamp_min(MIN_VARIANCE).sqrt()
    depth = np.add.reduceat((-torch.log1p(-opacity) * area).numpy(), starts)
    peak, growth = stacked(mean(opacity), torch.from_numpy(depth) / face_area(scales))
    return Splats(
        center.float(),
        (scales * growth[:, None]).float(),
        rotation_matrix_to_quaternion(axes.contiguous()).float(),
        peak.float(),
        mean(member.sh).float(),
        mean(member.label).float(),
    )


def stacked(opacity: Tensor, depth: Tensor) -> tuple[Tensor, Tensor]:
    """Peak opacity of a stack of layers, and by how much it must grow to cover what the layers cover.

    A pile of n equal layers of peak a has the profile 1 - (1 - a G)^n, which is wider than its peak times G. Layers
    in one place need the area to grow by the whole ratio of the two integrals, layers side by side not at all;
    members of a voxel are between, and take it to the power STACKED.

    Args:
        opacity: peak of one layer, (M,) in (0, 1).
        depth: optical depth of the pile at its middle, (M,) > 0.

    Returns:
        Peak (M,) in (0, MAX_ALPHA], and the factor (M,) >= 1 on standard deviations.
    """
    layers = depth / -torch.log1p(-opacity)
    peak = -torch.expm1(-depth)  # above 0 however thin the stack is
    steps = (torch.arange(STEPS, dtype=torch.float64) + 0.5) / STEPS * opacity[:, None]
    covered = ((1 - (1 - steps) ** layers[:, None]) / steps).mean(1) * opacity
    return peak.clamp(max=MAX_ALPHA), (covered / peak).clamp_min(1) ** (STACKED / 2)


def face_area(scales: Tensor) -> Tensor:
    """Product of the two largest standard deviations (N, 3), (N,): how large a Gaussian looks from its widest side."""
    ordered = scales.sort(dim=1).values
    return ordered[:, 1] * ordered[:, 2]


def subset(splats: Splats, index: Tensor) -> Splats:
    """Some of the Gaussians; ``index`` is (M,) int64 or (N,) bool."""
    parts: dict[str, Any] = {name: getattr(splats, name)[index] for name in PARTS}
    return replace(splats, **parts)


def joined(first: Splats, second: Splats) -> Splats:
    """The Gaussians of both."""
    parts: dict[str, Any] = {name: torch.cat([getattr(first, name), getattr(second, name)]) for name in PARTS}
    return replace(first, **parts)


def importance(splats: Splats, views: list[View]) -> Tensor:
    """Greatest share of a pixel that each Gaussian has in any of ``views``, (N,) float32 in [0, 1]."""
    found = torch.zeros(len(splats))
    order = packing_order(splats.means.numpy(), splats.opacity.numpy())
    found[torch.from_numpy(order)] = torch.from_numpy(weights(splats.packed, views))
    return found


def weighing_views(splats: Splats, cameras: Camera) -> list[View]:
    """Views to weigh ``splats`` by, whatever the unit of the scene: each of ``cameras`` with every one of ``WHOLE``.

    With the first what hangs before the lens hides nothing, with the second nothing that is seen there is cut off.
    """
    matrices = list(zip(cameras.w2c.numpy(), cameras.K.numpy()))
    distances = [_seen_distance(splats, cameras[i]) for i in range(len(cameras))]  # 3 ms each at 500k
    planes = [[near_plane(share * distance) for distance in distances] for share in WHOLE]
    return [
        make_view(w2c, K, cameras.size, Settings(*plane, antialiased=True))
        for of_share in planes
        for (w2c, K), plane in zip(matrices, of_share)
    ]


def _seen_distance(splats: Splats, camera: Camera) -> float:
    """Median depth [scene units] of what lies in the frame of one camera; 1 where nothing does."""
    pixels, depth = camera.project(splats.means[:: max(1, len(splats) // SAMPLE)])
    inside = (depth[0] > 0) & ((pixels[0] >= 0) & (pixels[0] <= pixels.new_tensor(camera.size))).all(1)
    return float(depth[0][inside].median()) if bool(inside.any()) else 1.0


def working_set(scene: Scene, cameras: Camera, k: float) -> Scene:
    """The scene with no more Gaussians than ``cameras`` can tell apart at their size; see :func:`merged`.

    Raises:
        UsageError: the scene is not made of splats.
        ResourceError: there is not enough memory to merge them.
    """
    check_merged(scene)
    return replace(scene, geometry=merged(scene.geometry, cameras, k))


def check_merged(scene: Scene) -> None:
    """Refuse a scene that cannot be merged.

    Raises:
        UsageError: it is not made of splats.
    """
    if not isinstance(scene.geometry, Splats):
        kind = type(scene.geometry).__name__
        raise UsageError(scene.name, "lod", f"expected Gaussian splats, got {kind}", "set lod=0")
