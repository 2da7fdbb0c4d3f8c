"""The colour of each pixel: vertex colours and textures, right in perspective, and a light at the camera."""

from __future__ import annotations

from math import sqrt

from numba import njit

from . import CACHED, INLINE, Array

_BYTE = 1 / 255


@njit(**INLINE)
def _weights(corners: Array, points: Array, x: float, y: float, out: Array) -> float:
    """Write the corners' weights where the ray (x, y, 1) meets the face; the cosine between ray and normal."""
    a, b, c = points[corners[0]], points[corners[1]], points[corners[2]]
    total = 0.0
    for k in range(3):
        p, q = points[corners[(k + 1) % 3]], points[corners[(k + 2) % 3]]
        out[k] = x * (p[1] * q[2] - p[2] * q[1]) + y * (p[2] * q[0] - p[0] * q[2]) + p[0] * q[1] - p[1] * q[0]
        total += out[k]
    for k in range(3):
        out[k] /= total
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    return abs(nx * x + ny * y + nz) / sqrt((nx * nx + ny * ny + nz * nz) * (x * x + y * y + 1))


@njit(**INLINE)
def _wrapped(place: float, count: int) -> tuple[int, int, float]:
    """The two texels about ``place`` (1 is the whole width) and the share of the second."""
    at = (place - place // 1) * count - 0.5
    low = int(at // 1)
    return (low + count) % count, (low + 1) % count, at - low


@njit(**CACHED)
def shade(mesh: tuple[Array, ...], points: Array, lens: Array, headlight: float, nearest: Array, image: Array) -> None:
    """Colour of every pixel.

    Args:
        mesh: faces (F, 3), colors (V, 3), uv (V, 2), shaded (F,), texture (F,), texels (T, 4) uint8, images (n, 4).
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
            facing = _weights(corners, points, x, y, weight)
            light = 1 - headlight + headlight * facing if shaded[f] else 1.0
            u = v = 0.0
            for k in range(3):
                u += weight[k] * uv[corners[k], 0]
                v += weight[k] * uv[corners[k], 1]
            for channel in range(3):
                value = light * (
                    weight[0] * colors[corners[0], channel]
                    + weight[1] * colors[corners[1], channel]
                    + weight[2] * colors[corners[2], channel]
                )
                if texture[f] >= 0:
                    start, width, height = images[texture[f], 0], images[texture[f], 1], images[texture[f], 2]
                    x0, x1, right = _wrapped(u, width)
                    y0, y1, down = _wrapped(v, height)
                    above, below = start + y0 * width, start + y1 * width
                    upper = texels[above + x0, channel] * (1 - right) + texels[above + x1, channel] * right
                    lower = texels[below + x0, channel] * (1 - right) + texels[below + x1, channel] * right
                    value *= (upper * (1 - down) + lower * down) * _BYTE
                image[channel, row, column] = min(max(value, 0.0), 1.0)
