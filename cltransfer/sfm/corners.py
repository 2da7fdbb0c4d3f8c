"""Points that are found again from frame to frame: SIFT (https://doi.org/10.1023/B:VISI.0000029664.99615.94)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

CORNERS, ON_SUBJECT = 1500, 500  # of a frame at most: off the subject, on it
CONTRAST = 0.02  # half of OpenCV's: smooth walls must give some too
WINDOW = 6  # frames apart that are matched at most
RATIO = 0.85  # distance of the nearest descriptor over that of the second nearest
UPSCALED = 0.25  # [px] by which OpenCV's SIFT finds corners too far down and to the right, in every octave
FEWEST = 20  # matches a pair of frames needs to count


@dataclass(frozen=True)
class Corners:
    """What one frame shows.

    Args:
        pixels: (P, 2) float64 [px], the centre of the first pixel at 0.5.
        descriptors: (P, 128) float32 of unit length.
        hidden: which lie on the subject, (P,) bool.
    """

    pixels: NDArray  # (P, 2) [px]
    descriptors: NDArray  # (P, 128)
    hidden: NDArray  # (P,) bool


@dataclass(frozen=True)
class Match:
    """Corners of two frames that look alike.

    Args:
        frames: the earlier and the later.
        index: of the corners in both, (M, 2).
    """

    frames: tuple[int, int]
    index: NDArray  # (M, 2)


def find_corners(frame: NDArray, subject: NDArray) -> Corners:
    """Corners of ``frame`` (H, W, 3) uint8 RGB; those within 2 % of its width of ``subject`` (H, W) bool are hidden.

    Each side of the outline has a count of its own, so that a patterned coat leaves some for the room.
    """
    grey = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)
    margin = 2 * round(0.02 * frame.shape[1]) + 1
    near = cv2.dilate(subject.astype(np.uint8), np.ones((margin, margin), np.uint8))
    off, on = _sift(grey, 1 - near, CORNERS), _sift(grey, near, ON_SUBJECT)
    places, descriptors = (np.concatenate(pair) for pair in zip(off, on))
    rooted = np.sqrt(descriptors / np.maximum(descriptors.sum(1, keepdims=True), 1e-9))  # Hellinger distance
    return Corners(places + 0.5 - UPSCALED, rooted, np.arange(len(places)) >= len(off[0]))


def _sift(grey: NDArray, mask: NDArray, count: int) -> tuple[NDArray, NDArray]:
    """Places (P, 2) [px, integer-centred] and descriptors (P, 128) under ``mask`` (H, W) uint8, the strongest."""
    # a limit of its own counts the whole frame; UPSCALED is what its usual upscaling moves corners by
    sift = cv2.SIFT.create(nfeatures=0, contrastThreshold=CONTRAST, enable_precise_upscale=False)
    found = sift.detect(grey, mask)
    strongest = np.argsort([-point.response for point in found], kind="stable")[:count]
    keypoints, descriptors = sift.compute(grey, [found[i] for i in strongest])
    if descriptors is None:
        return np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    return np.array([point.pt for point in keypoints]), descriptors


def match_clip(corners: list[Corners]) -> list[Match]:
    """Matches of all pairs of frames that are near in time; mutual, clear, and at least :data:`FEWEST` a pair."""
    pairs = [pair for pair in combinations(range(len(corners)), 2) if pair[1] - pair[0] <= WINDOW]
    found = (Match(pair, _alike(corners[pair[0]], corners[pair[1]])) for pair in pairs)
    return [match for match in found if len(match.index) >= FEWEST]


def _alike(first: Corners, second: Corners) -> NDArray:
    """Index pairs (M, 2) of mutual nearest neighbours that beat the second nearest."""
    if min(len(first.pixels), len(second.pixels)) < 2:
        return np.zeros((0, 2), int)
    likeness = first.descriptors @ second.descriptors.T
    forth, back = likeness.argmax(1), likeness.argmax(0)
    second_best, best = np.partition(likeness, -2, axis=1)[:, -2:].T
    clear = (1 - best) < RATIO**2 * (1 - second_best)  # |a - b|^2 = 2 - 2 a.b
    kept = np.flatnonzero(clear & (back[forth] == np.arange(len(forth))))
    return np.stack([kept, forth[kept]], axis=1)
