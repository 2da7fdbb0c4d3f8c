from __future__ import annotations

import cv2
import numpy as np
import pytest

from cltransfer.scenes.posed.lens import Lens, straighten

BENT = Lens((160, 120), (130.0, 128.0), (81.0, 59.0), (-0.25, 0.06, 0.001, -0.002))


def bent_pixel(lens: Lens, ray: np.ndarray) -> np.ndarray:
    """Where OpenCV's printed formula puts a ray (x, y, 1), pixels with their corner at 0."""
    k1, k2, p1, p2 = lens.distortion
    x, y = ray[:2]
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2
    bent = [x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y]
    return np.array([lens.focal[0] * bent[0] + lens.center[0], lens.focal[1] * bent[1] + lens.center[1]])


def spot(at: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    bright = 255 * np.exp(-((x - at[0]) ** 2 + (y - at[1]) ** 2) / (2 * 2.0**2))
    return np.repeat(bright[..., None], 3, axis=2).round().astype(np.uint8)


def middle(image: np.ndarray) -> np.ndarray:
    weight = image[..., 0].astype(float)
    y, x = np.mgrid[: image.shape[0], : image.shape[1]] + 0.5
    return np.array([(weight * x).sum(), (weight * y).sum()]) / weight.sum()


@pytest.mark.parametrize("shrink", [1, 2])
@pytest.mark.parametrize("ray", [(0.0, 0.0, 1.0), (0.35, 0.2, 1.0), (-0.4, 0.3, 1.0)])
def test_a_straightened_image_shows_a_ray_where_its_K_says(ray: tuple[float, float, float], shrink: int) -> None:
    image = spot(bent_pixel(BENT, np.array(ray)), BENT.size)
    image = cv2.resize(image, (BENT.size[0] // shrink, BENT.size[1] // shrink), interpolation=cv2.INTER_AREA)
    K = BENT.straight_matrix()
    expected = (K @ np.array(ray))[:2] / shrink
    assert middle(straighten(image, BENT, K)) == pytest.approx(expected, abs=0.15)


def test_every_pixel_of_a_straightened_image_was_seen() -> None:
    white = np.full((120, 160, 3), 255, np.uint8)
    assert straighten(white, BENT, BENT.straight_matrix()).min() > 250


def test_a_straight_lens_changes_nothing() -> None:
    lens = Lens((8, 6), (5.0, 5.0), (4.0, 3.0))
    image = np.arange(144, dtype=np.uint8).reshape(6, 8, 3)
    assert straighten(image, lens, lens.matrix) is image
    assert np.array_equal(lens.straight_matrix(), lens.matrix)


@pytest.mark.parametrize(
    "distortion",
    [
        (0, 0, 5, 5),
        (1e300,),
        (-1e8,),
        (-0.6,),
        (50,),
        (1e300,) * 4,
        (0, 0, 0, 0, 0, -5),
        (0, 0, 0.5, 0.5),
    ],
)
def test_a_lens_that_folds_its_image_or_leaves_none_of_it_cannot_be_straightened(distortion: tuple[float, ...]) -> None:
    assert not Lens((1600, 1200), (1000.0, 1000.0), (800.0, 600.0), distortion).can_be_straightened
    assert not Lens((1, 1), (1e-300, 1e-300), (0.5, 0.5), distortion).can_be_straightened


@pytest.mark.parametrize(
    ("focal", "distortion"),
    [
        (1000.0, ()),
        (1000.0, (-0.25, 0.06, 0.001, -0.002)),
        (700.0, (-0.27, 0.11, 0, 0, -0.03)),  # of an action camera
        (1000.0, (0.2, -0.1)),
        (1000.0, (0.1, 0.01, 0, 0, 0.01, 0.2, 0.02, 0.01)),
    ],
)
def test_lenses_as_they_are_can_be_straightened(focal: float, distortion: tuple[float, ...]) -> None:
    assert Lens((1600, 900), (focal, focal), (800.0, 450.0), distortion).can_be_straightened
