"""Triangle meshes on the CPU: many cameras, one thread a camera."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from . import Array
from .mesh_raster import HOLE, rasterise, to_camera
from .mesh_shade import shade


class Packed(NamedTuple):
    """A mesh in arrays."""

    vertices: Array  # (V, 3) float32
    faces: Array  # (F, 3) int32
    colors: Array  # (V, 3) float32
    uv: Array  # (V, 2) float32
    label: Array  # (F,) float32
    shaded: Array  # (F,) bool
    texture: Array  # (F,) int32
    texels: Array  # (T, 4) uint8, all textures in turn
    images: Array  # (n, 4) int64: first texel, width, height, whether it has holes


class Views(NamedTuple):
    """B cameras of one size."""

    w2c: Array  # (B, 4, 4) float64
    lens: Array  # (B, 4) float64: fx, fy, cx, cy [px]
    size: tuple[int, int]  # (W, H) [px]


class Light(NamedTuple):
    """What is drawn, and how it is lit."""

    near: float
    headlight: float


class Seen(NamedTuple):
    """What B cameras see."""

    face: Array  # (B, H, W) int32, -1 where nothing is
    inverse: Array  # (B, H, W) float32, 1 / depth, 0 where nothing is
    image: Array  # (B, 3, H, W) float32 in [0, 1]; (B, 0, H, W) where it was not asked for


def pack_images(images: Sequence[Array]) -> tuple[Array, Array]:
    """Texels (T, 4) uint8 and table (n, 4) int64 of RGBA images (h, w, 4)."""
    rows, first = [], 0
    for image in images:
        height, width = image.shape[:2]
        rows.append((first, width, height, int((image[..., 3] < HOLE).any())))
        first += height * width
    texels = [image.reshape(-1, 4) for image in images] or [np.empty((0, 4), np.uint8)]
    return np.ascontiguousarray(np.concatenate(texels)), np.array(rows, np.int64).reshape(-1, 4)


def render(packed: Packed, views: Views, light: Light, color: bool, threads: int) -> Seen:
    """What each of the views sees; ``threads`` of them are drawn at once, which does not change the result."""
    shape = (len(views.w2c), views.size[1], views.size[0])
    image = np.empty((shape[0], 3 if color else 0, *shape[1:]), np.float32)
    seen = Seen(np.empty(shape, np.int32), np.empty(shape, np.float32), image)
    work = iter(range(shape[0]))
    workers = min(threads, shape[0])
    if workers == 1:
        _work(work, packed, views, light, seen)
        return seen
    with ThreadPoolExecutor(workers) as pool:
        for task in [pool.submit(_work, work, packed, views, light, seen) for _ in range(workers)]:
            task.result()
    return seen


def _work(indices: Iterator[int], packed: Packed, views: Views, light: Light, seen: Seen) -> None:
    """Draw views from a queue that threads share."""
    points, pixels = np.empty((len(packed.vertices), 3)), np.empty((len(packed.vertices), 2))
    shapes = (packed.faces, packed.uv, packed.texture, packed.texels, packed.images)
    surface = (packed.faces, packed.colors, packed.uv, packed.shaded, packed.texture, packed.texels, packed.images)
    for i in indices:
        lens = views.lens[i]
        to_camera(packed.vertices, views.w2c[i, :3], lens, points, pixels)
        rasterise(shapes, points, pixels, lens, light.near, seen.inverse[i], seen.face[i])
        if seen.image.shape[1]:
            shade(surface, points, lens, light.headlight, seen.face[i], seen.image[i])
