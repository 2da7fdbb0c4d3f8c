"""Corners of a frame: each side of the subject's outline has a count of its own."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from cltransfer.sfm.corners import CORNERS, ON_SUBJECT, find_corners

SIZE = (960, 540)


def noise(low: int, high: int) -> np.ndarray:
    coarse = np.random.default_rng(0).integers(low, high, (SIZE[1] // 4, SIZE[0] // 4), np.uint8)
    return cv2.resize(coarse, SIZE, interpolation=cv2.INTER_NEAREST)


@pytest.mark.parametrize("striking", ["subject", "room"])
def test_what_strikes_on_one_side_leaves_the_other_its_corners(striking: str) -> None:
    subject = np.zeros(SIZE[::-1], bool)
    subject[100:, 360:600] = True
    frame = np.where(subject == (striking == "subject"), noise(0, 255), noise(100, 156))
    found = find_corners(np.repeat(frame[..., None], 3, axis=2), subject)
    assert 1000 < int((~found.hidden).sum()) <= CORNERS
    assert 400 < int(found.hidden.sum()) <= ON_SUBJECT
    assert len(found.descriptors) == len(found.pixels)


@pytest.mark.parametrize("blur", [2.0, 5.0])
def test_a_corner_lies_where_it_is_shown(blur: float) -> None:
    """In the middle of a blurred spot, whose middle lies anywhere in its pixel; the first pixel's is at 0.5."""
    spread = np.random.default_rng(0).uniform(0, 1, (24, 2))
    middles = np.stack(np.meshgrid(np.arange(40, 300, 50), np.arange(40, 220, 50)), axis=-1).reshape(-1, 2) + spread
    row, column = np.mgrid[:240, :320] + 0.5
    grey = 60 + sum(150 * np.exp(-((column - x) ** 2 + (row - y) ** 2) / (2 * blur**2)) for x, y in middles)
    frame = np.repeat(grey.round().astype(np.uint8)[..., None], 3, axis=2)
    found = find_corners(frame, np.zeros((240, 320), bool)).pixels
    off = found[:, None] - middles
    nearest = np.abs(off).sum(-1).argmin(1)
    off = off[np.arange(len(found)), nearest]
    inside = np.abs(off).max(1) < 2  # others lie between the spots
    assert set(nearest[inside]) == set(range(len(middles)))
    assert np.abs(off[inside]).max() < 0.1
