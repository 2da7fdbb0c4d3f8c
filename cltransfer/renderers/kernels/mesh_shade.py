"""The colour of each pixel: vertex colours and textures, right in perspective, and a light at the camera."""

from __future__ import annotations

from math import floor, sqrt

from numba import njit

from ...computer.compiled import kernel
from . import CACHED, INLINE, Array
from .mesh_raster import ACROSS, DOWN, HEIGHT, OFFSET, REPEAT, WIDTH, wrapped

_BYTE = 1 / 255


@njit(**INLINE)
def _weights(corners: Array, points: Array, x: float, y: float, out: Array) -> None:
    """Write the corners' weights where the ray (x, y, 1) meets the face."""
    total = 0.0
    for k in range(3):
        i, j = corners[(k + 1) % 3], corners[(k + 2) % 3]
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        qx, qy, qz = points[j, 0], points[j, 1], points[j, 2]
        out[k] = x * (py * qz - pz * qy) + y * (pz * qx - px * qz) + px * qy - py * qx
        total += out[k]
    inverse = 1 / total
    for k in range(3):
        out[k] *= inverse


@njit(**INLINE)
def _facing(corners: Array, points: Array, x: float, y: float) -> float:
    """Cosine between the ray (x, y, 1) and the face's normal, without its sign."""
    a, b, c = points[corners[0]], points[corners[1]], points[corners[2]]
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    return abs(nx * x + ny * y + nz) / sqrt((nx * nx + ny * ny + nz * nz) * (x * x + y * y + 1))


@njit(**INLINE)
def _texels(place: float, count: int, wrap: int) -> tuple[int, int, float]:
    """The two texels about ``place`` (1 is the whole width) and the share of the second; what is no number is at 0."""
    at = wrapped(place, wrap) * count - 0.5
    low = floor(at)
    high = low + 1
    before, after = (count - 1, 0) if wrap == REPEAT else (0, count - 1)  # beyond the edges
    return low if low >= 0 else before, high if high < count else after, at - low


@njit(**INLINE)
def _between(texels: Array, rows: tuple[int, int], columns: tuple[int, int, float], down: float, channel: int) -> float:
    """Bilinear value of one channel, in [0, 1]."""
    left, right, share = columns
    upper = texels[rows[0] + left, channel] * (1 - share) + texels[rows[0] + right, channel] * share
    lower = texels[rows[1] + left, channel] * (1 - share) + texels[rows[1] + right, channel] * share
    return (upper * (1 - down) + lower * down) * _BYTE


@kernel(**CACHED)
def shade(mesh: tuple[Array, ...], points: Array, lens: Array, headlight: float, nearest: Array, image: Array) -> None:
    """Colour of every pixel.

    Args:
        mesh: faces (F, 3), colors (V, 3), uv (V, 2), shaded (F,), texture (F,), texels (T, 4) uint8, images (n, 6).
        points: camera points of the vertices, (V, 3).
        lens: fx, fy, cx, cy [px].
        headlight: share of the light that comes from the camera, in [0, 1].
        nearest: face of each pixel, (H, W).
        image: (3, H, W) float32; written, black where nothing is seen.
    """
    faces, colors, uv, shaded, texture, texels, images = mesh
    weight = lens[:3].copy()
    for row in range(nearest.shape[0]):
        for column in range(nearest.shape[1]):
            f = nearest[row, column]
            if f < 0:
                image[0, row, column] = image[1, row, column] = image[2, row, column] = 0
                continue
            corners = faces[f]
            x, y = (column + 0.5 - lens[2]) / lens[0], (row + 0.5 - lens[3]) / lens[1]
            _weights(corners, points, x, y, weight)
            light = 1 - headlight + headlight * _facing(corners, points, x, y) if shaded[f] else 1.0
            rows, columns, down = (0, 0), (0, 0, 0.0), 0.0
            textured = texture[f] >= 0
            if textured:
                u = weight[0] * uv[corners[0], 0] + weight[1] * uv[corners[1], 0] + weight[2] * uv[corners[2], 0]
                v = weight[0] * uv[corners[0], 1] + weight[1] * uv[corners[1], 1] + weight[2] * uv[corners[2], 1]
                about = images[texture[f]]
                start, width, height = about[OFFSET], about[WIDTH], about[HEIGHT]
                columns = _texels(u, width, about[ACROSS])
                above, below, down = _texels(v, height, about[DOWN])
                rows = (start + above * width, start + below * width)
            for channel in range(3):
                value = light * (
                    weight[0] * colors[corners[0], channel]
                    + weight[1] * colors[corners[1], channel]
                    + weight[2] * colors[corners[2], channel]
                )
                if textured:
                    value *= _between(texels, rows, columns, down, channel)
                image[channel, row, column] = min(max(value, 0.0), 1.0)
