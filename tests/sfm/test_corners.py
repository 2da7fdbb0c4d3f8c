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
