"""Which triangle each pixel sees: a z-buffer over planes in homogeneous coordinates (Olano and Greer 1997).

A triangle with camera points A, B, C covers a ray d where d.(BxC), d.(CxA), d.(AxB) have the sign of det(A, B, C).
Divided by that determinant they are the corners' weights over depth: linear in the pixel, summing to 1 / depth. So a
triangle that crosses the near plane needs no new corners, only a box of pixels that ends where the plane cuts it.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ...computer.compiled import kernel
from . import CACHED, INLINE, Array, f32

INSIDE = -1e-9  # weight of a corner that still counts as inside: closes the seam between two faces
FLAT = 1e-13  # determinant over the product of the corners' distances: a face seen from its edge
HOLE = 128  # texture alpha below which nothing is drawn
OFFSET, WIDTH, HEIGHT, HOLES, ACROSS, DOWN = 0, 1, 2, 3, 4, 5  # columns of an image row
REPEAT, CLAMP, MIRROR = 0, 1, 2  # wraps: how an image goes on beyond its edges, along one axis


@kernel(**CACHED)
def to_camera(vertices: Array, view: Array, lens: Array, points: Array, pixels: Array) -> None:
    """Camera points (V, 3) and pixels (V, 2) of world vertices; behind the camera a pixel means nothing.

    Args:
        vertices: (V, 3) float32.
        view: rows of w2c, (3, 4) float64.
        lens: focal lengths and principal point fx, fy, cx, cy, (4,) float64 [px].
        points: (V, 3) float64, written.
        pixels: (V, 2) float64, written.
    """
    for i in range(len(vertices)):
        x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        px = view[0, 0] * x + view[0, 1] * y + view[0, 2] * z + view[0, 3]
        py = view[1, 0] * x + view[1, 1] * y + view[1, 2] * z + view[1, 3]
        pz = view[2, 0] * x + view[2, 1] * y + view[2, 2] * z + view[2, 3]
        points[i, 0], points[i, 1], points[i, 2] = px, py, pz
        inverse = 1.0 / pz
        pixels[i, 0] = lens[0] * px * inverse + lens[2]
        pixels[i, 1] = lens[1] * py * inverse + lens[3]


@njit(**INLINE)
def _box(corners: Array, points: Array, pixels: Array, lens: Array, near: float) -> tuple[float, float, float, float]:
    """Left, top, right, bottom [px] of the part of a face beyond the near plane; right < left where there is none."""
    left, top, right, bottom = 1e30, 1e30, -1e30, -1e30
    for k in range(3):
        a, b = corners[k], corners[(k + 1) % 3]
        za, zb = points[a, 2], points[b, 2]
        if za >= near:
            left, right = min(left, pixels[a, 0]), max(right, pixels[a, 0])
            top, bottom = min(top, pixels[a, 1]), max(bottom, pixels[a, 1])
        if (za >= near) != (zb >= near):
            t = (near - za) / (zb - za)
            x = lens[0] * (points[a, 0] + t * (points[b, 0] - points[a, 0])) / near + lens[2]
            y = lens[1] * (points[a, 1] + t * (points[b, 1] - points[a, 1])) / near + lens[3]
            left, right, top, bottom = min(left, x), max(right, x), min(top, y), max(bottom, y)
    return left, top, right, bottom


@njit(**INLINE)
def _planes(corners: Array, points: Array, lens: Array, planes: Array) -> bool:
    """Write each corner's weight over depth as slope in x, slope in y and value at pixel (0, 0); False if seen flat."""
    distances = 1.0
    for k in range(3):
        i, j = corners[(k + 1) % 3], corners[(k + 2) % 3]
        planes[k, 0] = points[i, 1] * points[j, 2] - points[i, 2] * points[j, 1]
        planes[k, 1] = points[i, 2] * points[j, 0] - points[i, 0] * points[j, 2]
        planes[k, 2] = points[i, 0] * points[j, 1] - points[i, 1] * points[j, 0]
        distances *= points[i, 0] ** 2 + points[i, 1] ** 2 + points[i, 2] ** 2
    first = corners[0]
    determinant = points[first, 0] * planes[0, 0] + points[first, 1] * planes[0, 1] + points[first, 2] * planes[0, 2]
    if determinant * determinant <= FLAT * FLAT * distances:
        return False
    for k in range(3):
        slope_x, slope_y = planes[k, 0] / (lens[0] * determinant), planes[k, 1] / (lens[1] * determinant)
        planes[k, 2] = planes[k, 2] / determinant - slope_x * lens[2] - slope_y * lens[3]
        planes[k, 0], planes[k, 1] = slope_x, slope_y
    return True


@njit(**INLINE)
def wrapped(place: float, wrap: int) -> float:
    """``place`` (1 is the whole width) brought into [0, 1]; what is no number is at 0."""
    inside = place - np.floor(place)  # as a float: a huge place would overflow an integer
    if wrap == CLAMP:
        inside = 1.0 if place > 1 else place
    elif wrap == MIRROR:
        inside = place - 2 * np.floor(0.5 * place)
        inside = inside if inside <= 1 else 2 - inside
    return inside if inside >= 0 else 0.0


@njit(**INLINE)
def _texel(place: float, count: int, wrap: int) -> int:
    """The texel at ``place`` (1 is the whole width); what is no number is at 0."""
    return min(int(wrapped(place, wrap) * count), count - 1)


@njit(**INLINE)
def _is_hole(u: float, v: float, image: Array, texels: Array) -> bool:
    """Whether the texel at (u, v) is transparent."""
    column, row = _texel(u, image[WIDTH], image[ACROSS]), _texel(v, image[HEIGHT], image[DOWN])
    return texels[image[OFFSET] + row * image[WIDTH] + column, 3] < HOLE


@kernel(**CACHED)
def rasterise(
    mesh: tuple[Array, ...], points: Array, pixels: Array, lens: Array, near: float, seen: tuple[Array, Array]
) -> None:
    """Nearest face of each pixel.

    Args:
        mesh: faces (F, 3) int32, uv (V, 2), texture (F,) int32, texels (T, 4) uint8, images (n, 6) int64.
        points: of :func:`to_camera`, (V, 3).
        pixels: of :func:`to_camera`, (V, 2).
        lens: (4,) float64 [px].
        near: nothing nearer is drawn.
        seen: 1 / depth, (H, W) float32, 0 where nothing is seen, and the face, (H, W) int32, -1 there; written.
    """
    faces, uv, texture, texels, images = mesh
    inverse, nearest = seen
    height, width = nearest.shape
    inverse[:] = 0
    nearest[:] = -1
    farthest_inverse = 1 / near
    planes = np.empty((3, 3))
    for f in range(len(faces)):
        corners = faces[f]
        left, top, right, bottom = _box(corners, points, pixels, lens, near)
        if not (right >= 0.5 and left <= width - 0.5 and bottom >= 0.5 and top <= height - 0.5):
            continue
        # grown by a hair, as the inside test is: a seam may lie on pixel centres
        x0, x1 = int(max(left + 0.499999, 0.0)), int(min(right + 0.500001, float(width)))
        y0, y1 = int(max(top + 0.499999, 0.0)), int(min(bottom + 0.500001, float(height)))
        if x0 >= x1 or y0 >= y1 or not _planes(corners, points, lens, planes):
            continue
        image = texture[f]
        holes = image >= 0 and images[image, HOLES] == 1
        for y in range(y0, y1):
            row0 = planes[0, 1] * (y + 0.5) + planes[0, 2]
            row1 = planes[1, 1] * (y + 0.5) + planes[1, 2]
            row2 = planes[2, 1] * (y + 0.5) + planes[2, 2]
            for x in range(x0, x1):
                a, b = row0 + planes[0, 0] * (x + 0.5), row1 + planes[1, 0] * (x + 0.5)
                c = row2 + planes[2, 0] * (x + 0.5)
                total = a + b + c
                nearer = f32(total) > inverse[y, x]  # as it is kept: of faces at one place the first is seen
                if not (nearer and total <= farthest_inverse and min(a, b, c) >= INSIDE * total):
                    continue
                if holes:
                    u = (a * uv[corners[0], 0] + b * uv[corners[1], 0] + c * uv[corners[2], 0]) / total
                    v = (a * uv[corners[0], 1] + b * uv[corners[1], 1] + c * uv[corners[2], 1]) / total
                    if _is_hole(u, v, images[image], texels):
                        continue
                inverse[y, x] = f32(total)
                nearest[y, x] = f


@kernel(**CACHED)
def resolve(label: Array, inverse: Array, nearest: Array, depth: Array, alpha: Array, member: Array) -> None:
    """Buffers of the faces seen.

    Args:
        label: of each face, (F,) float32.
        inverse: 1 / depth, of :func:`rasterise`, (H, W).
        nearest: face, of :func:`rasterise`, (H, W).
        depth: (H, W) float32, written; NaN where nothing is seen.
        alpha: (H, W) float32, written.
        member: label of the face seen, (H, W) float32, written.
    """
    for y in range(nearest.shape[0]):
        for x in range(nearest.shape[1]):
            f = nearest[y, x]
            depth[y, x] = f32(1) / inverse[y, x] if f >= 0 else f32(np.nan)
            alpha[y, x] = f32(1) if f >= 0 else f32(0)
            member[y, x] = label[f] if f >= 0 else f32(0)
