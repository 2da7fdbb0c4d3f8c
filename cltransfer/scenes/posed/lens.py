"""Lenses as posed image sets describe them, and images made straight."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ...computer.array_type import Array

FARTHEST = 10  # times that straightening may change a focal length
STEPS = 257  # from the middle of a straightened image to its corner, at which a lens is looked at
HALF_PIXEL = np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])


@dataclass(frozen=True)
class Lens:
    """A pinhole with the distortion of OpenCV's model; pixels have their corner at 0.

    Args:
        size: (W, H) [px].
        focal: along x and y [px].
        center: principal point x and y [px].
        distortion: k1, k2, p1, p2, k3, k4, k5, k6 or as many of them as there are; none is a straight lens.
    """

    size: tuple[int, int]
    focal: tuple[float, float]
    center: tuple[float, float]
    distortion: tuple[float, ...] = ()

    @property
    def matrix(self) -> Array:
        """Intrinsics with the lens's own focal length, (3, 3) [px]."""
        (fx, fy), (cx, cy) = self.focal, self.center
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])

    @property
    def bends(self) -> bool:
        """Whether there is any distortion."""
        return any(self.distortion)

    def straight_matrix(self) -> Array:
        """Intrinsics (3, 3) [px] of the straightened image: every pixel of it was seen."""
        if not self.bends:
            return self.matrix
        K, _ = cv2.getOptimalNewCameraMatrix(_centred(self.matrix), self._coefficients, self.size, alpha=0)
        return _cornered(K)

    @property
    def can_be_straightened(self) -> bool:
        """Whether its straightened image has about its focal length, and shows nothing twice."""
        if not self.bends:
            return True
        K = self.straight_matrix()
        with np.errstate(all="ignore"):  # what is beyond all numbers is refused
            change = np.diag(K)[:2] / self.focal
            corners = np.array([[0, 0, 1, 1], [0, 1, 0, 1]]).T * self.size
            farthest = np.linalg.norm((corners - K[:2, 2]) / np.diag(K)[:2], axis=1).max()
            outwards = np.diff(self._bent(np.linspace(0, farthest, STEPS)))
        sensible = (change >= 1 / FARTHEST) & (change <= FARTHEST)
        return bool(sensible.all() and (outwards > 0).all())

    def _bent(self, radius: Array) -> Array:
        """How far from the middle a lens puts what is at ``radius`` in front of it, both in focal lengths."""
        k1, k2, _, _, k3, k4, k5, k6 = np.pad(self._coefficients, (0, 8))[:8]
        r2 = radius**2
        return np.asarray(radius * (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6))))

    @property
    def _coefficients(self) -> Array:
        count = next(n for n in (4, 5, 8) if n >= len(self.distortion))
        return np.pad(np.array(self.distortion, np.float64), (0, count - len(self.distortion)))


def straighten(image: Array, lens: Lens, K: Array) -> Array:
    """Image (H, W, 3) uint8 of any size as a pinhole with ``K`` (3, 3) [px at the lens's size] would have seen it."""
    if not lens.bends:
        return image
    height, width = image.shape[:2]
    scale = np.array([[width / lens.size[0]], [height / lens.size[1]], [1.0]])
    maps = cv2.initUndistortRectifyMap(
        _centred(lens.matrix * scale), lens._coefficients, None, _centred(K * scale), (width, height), cv2.CV_32FC1
    )
    return cv2.remap(image, *maps, cv2.INTER_LINEAR)


def crop(size: tuple[int, int], shape: tuple[int, int]) -> tuple[int, int, int, int]:
    """The middle of an image of ``size`` (W, H) that has the shape of (W, H): left, top, width and height [px].

    >>> crop((480, 640), (640, 480))
    (0, 140, 480, 360)
    """
    scale = min(size[0] / shape[0], size[1] / shape[1])
    width, height = max(1, round(shape[0] * scale)), max(1, round(shape[1] * scale))
    return (size[0] - width) // 2, (size[1] - height) // 2, width, height


def matrix_at(lens: Lens, size: tuple[int, int]) -> Array:
    """Intrinsics (3, 3) [px] of the straightened image, brought to ``size`` (W, H); cut where the shapes differ."""
    left, top, width, height = crop(lens.size, size)
    K = lens.straight_matrix()
    K[:2, 2] -= left, top
    return np.diag([size[0] / width, size[1] / height, 1.0]) @ K


def image_at(image: Array, lens: Lens, size: tuple[int, int]) -> Array:
    """What a pinhole with :func:`matrix_at` would have seen, ``size`` (W, H), of an image (H, W, 3) of any size."""
    straight = straighten(image, lens, lens.straight_matrix())
    scale = np.array(image.shape[1::-1]) / lens.size
    box = np.array(crop(lens.size, size)).reshape(2, 2) * scale  # corner and sides in pixels of the image, in parts too
    whole = np.maximum(1, box[1].round())
    step = box[1] / whole
    cut = np.column_stack([np.diag(step), box[0] + (step - 1) / 2])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    middle = cv2.warpAffine(straight, cut, whole.astype(int).tolist(), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return cv2.resize(middle, size, interpolation=cv2.INTER_AREA)


def _centred(K: Array) -> Array:
    """K for OpenCV, where the centre of the first pixel is 0."""
    return K - HALF_PIXEL


def _cornered(K: Array) -> Array:
    return K + HALF_PIXEL
