"""Triangle meshes on the CPU: many cameras, one thread a camera."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from ...computer.memory import LITTLE, affordable, require_free
from . import Array
from .mesh_pool import pool
from .mesh_raster import HOLE, rasterise, resolve, to_camera
from .mesh_shade import shade

RAY_BYTES, COLOR_BYTES, VERTEX_BYTES = 24, 12, 40  # of a thread's scratch
PIXEL_BYTES = 16  # of a frame, without its colour


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
    images: Array  # (n, 6) int64: first texel, width, height, whether it has holes, wrap across and down


class Views(NamedTuple):
    """B cameras of one size."""

    w2c: Array  # (B, 4, 4) float64
    lens: Array  # (B, 4) float64: fx, fy, cx, cy [px]
    size: tuple[int, int]  # (W, H) [px]


class Settings(NamedTuple):
    """How it is drawn."""

    near: float
    headlight: float
    samples: int  # rays a pixel along each axis


class Buffers(NamedTuple):
    """What B cameras see, float32."""

    depth: Array  # (B, H, W), NaN where nothing is
    expected_depth: Array  # (B, H, W), NaN where nothing is
    alpha: Array  # (B, H, W)
    label: Array  # (B, H, W)
    image: Array  # (B, 3, H, W) in [0, 1]; (B, 0, H, W) where it was not asked for


def _buffers(count: int, size: tuple[int, int], color: bool) -> Buffers:
    shape = (count, size[1], size[0])
    depth, expected_depth, alpha, label = (np.empty(shape, np.float32) for _ in range(4))
    image = np.empty((count, 3 if color else 0, *shape[1:]), np.float32)
    return Buffers(depth, expected_depth, alpha, label, image)


def pack_images(images: Sequence[Array], wraps: Sequence[tuple[int, int]]) -> tuple[Array, Array]:
    """Texels (T, 4) uint8 and table (n, 6) int64 of RGBA images (h, w, 4), and of how each goes on beyond its edges.

    The same array under several wraps is packed once.
    """
    texels = {id(image): image.reshape(-1, 4) for image in images}
    first = dict(zip(texels, np.cumsum([0, *map(len, texels.values())])))
    rows = []
    for image, (across, down) in zip(images, wraps, strict=True):
        height, width = image.shape[:2]
        rows.append((first[id(image)], width, height, int((image[..., 3] < HOLE).any()), across, down))
    every = [*texels.values()] or [np.empty((0, 4), np.uint8)]
    return np.ascontiguousarray(np.concatenate(every)), np.array(rows, np.int64).reshape(-1, 6)


def render(packed: Packed, views: Views, settings: Settings, color: bool, threads: int) -> Buffers:
    """What each of the views sees; at most ``threads`` are drawn at once, fewer where their scratch would not fit.

    The result does not depend on it.

    Raises:
        ResourceError: they and the scratch of one do not fit in memory.
    """
    count, samples = len(views.w2c), settings.samples
    need = scratch_bytes(len(packed.vertices), views.size, samples, color)
    frames = count * views.size[0] * views.size[1] * (PIXEL_BYTES + COLOR_BYTES * color)
    if need + frames > LITTLE:
        what = f"{samples}x{samples} rays a pixel of frames of {views.size[0]}x{views.size[1]}"
        require_free(need + frames, "", what, "take fewer samples" if samples > 1 else "draw smaller frames")
    workers = affordable(min(threads, count), need, frames)
    out = _buffers(count, views.size, color)
    work = iter(range(count))
    if workers == 1:
        _work(work, packed, views, settings, out)
        return out
    with ThreadPoolExecutor(workers) as pool_of_threads:
        tasks = [pool_of_threads.submit(_work, work, packed, views, settings, out) for _ in range(workers)]
        for task in tasks:
            task.result()
    return out


def scratch_bytes(vertices: int, size: tuple[int, int], samples: int, color: bool) -> int:
    """What a thread works in: planes of every ray, and the places of the vertices."""
    return samples**2 * size[0] * size[1] * (RAY_BYTES + COLOR_BYTES * color) + VERTEX_BYTES * vertices


def _work(indices: Iterator[int], packed: Packed, views: Views, settings: Settings, out: Buffers) -> None:
    """Draw views from a queue that threads share."""
    points, pixels = np.empty((len(packed.vertices), 3)), np.empty((len(packed.vertices), 2))
    n = settings.samples
    size = (n * views.size[0], n * views.size[1])
    inverse, nearest = np.empty(size[::-1], np.float32), np.empty(size[::-1], np.int32)
    fine = Buffers(*(buffer[0] for buffer in _buffers(1, size, bool(out.image.shape[1]))))
    shapes = (packed.faces, packed.uv, packed.texture, packed.texels, packed.images)
    surface = (packed.faces, packed.colors, packed.uv, packed.shaded, packed.texture, packed.texels, packed.images)
    for i in indices:
        lens = n * views.lens[i]
        to_camera(packed.vertices, views.w2c[i, :3], lens, points, pixels)
        rasterise(shapes, points, pixels, lens, settings.near, (inverse, nearest))
        resolve(packed.label, inverse, nearest, fine.depth, fine.alpha, fine.label)
        if len(fine.image):
            shade(surface, points, lens, settings.headlight, nearest, fine.image)
        planes = (out.depth[i], out.expected_depth[i], out.alpha[i], out.label[i])
        pool((fine.depth, fine.alpha, fine.label, fine.image), n, planes, out.image[i])
