"""Whether a clip's camera moves at all, before anything is reconstructed from it."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import fmean

import cv2
import numpy as np
from numpy.typing import NDArray

from . import NoPathError, load_pycolmap
from .corners import FEWEST, Corners, Match

INLIER = 1.5 / 640  # distance from an epipolar line or from a homography's point that agrees [frame widths]
OFF = 4 / 640  # distance from a homography's point that tells of parallax [frame widths]
ENOUGH = 50  # corners of a pair of frames that must agree for it to bear witness
STILL = 0.5 / 640  # movement of the median corner below which a camera stands still [frame widths]
SHARE = 0.15  # of the corners must show parallax; rendered pans, tilts and zooms showed 0.09 at most


@dataclass(frozen=True)
class Evidence:
    """What one pair of frames says.

    Args:
        match: its matches that agree with one epipolar geometry, off the subject.
        fundamental: x'^T F x = 0 of pixels, (3, 3).
        moved: median movement [frame widths].
        parallax: share of the matches that no homography explains, [0, 1].
    """

    match: Match
    fundamental: NDArray  # (3, 3)
    moved: float
    parallax: float


def weigh(corners: list[Corners], matches: list[Match], width: int) -> list[Evidence]:
    """Evidence of every pair with enough matches off the subject that agree.

    A homography explains all of a still, turning or zooming camera, and all of a flat scene; what it leaves over is
    parallax.

    Raises:
        ModelError: pycolmap is not installed.
    """
    pycolmap = load_pycolmap()
    ransac = pycolmap.RANSACOptions(max_error=INLIER * width, random_seed=0, max_num_trials=10_000)
    found = []
    for match in matches:
        first, second = (corners[frame] for frame in match.frames)
        seen = match.index[~first.hidden[match.index[:, 0]] & ~second.hidden[match.index[:, 1]]]
        if len(seen) < FEWEST:
            continue
        a, b = first.pixels[seen[:, 0]], second.pixels[seen[:, 1]]
        lines, plane = (
            pycolmap.estimate_fundamental_matrix(a, b, ransac),
            pycolmap.estimate_homography_matrix(a, b, ransac),
        )
        if lines is None or plane is None or lines["num_inliers"] < FEWEST:
            continue
        kept = lines["inlier_mask"]
        left = np.linalg.norm(cv2.perspectiveTransform(a[kept][:, None], plane["H"])[:, 0] - b[kept], axis=1)
        moved = float(np.median(np.linalg.norm(a[kept] - b[kept], axis=1))) / width
        found.append(Evidence(Match(match.frames, seen[kept]), lines["F"], moved, float((left > OFF * width).mean())))
    return found


def require_parallax(evidence: list[Evidence]) -> None:
    """Refuse a clip that shows no parallax.

    Raises:
        NoPathError: too little is found again, the camera stands still, or one homography explains every pair.
    """
    witnesses = [pair for pair in evidence if len(pair.match.index) >= ENOUGH]
    if not witnesses:
        best = max((len(pair.match.index) for pair in evidence), default=0)
        reason = f"no two frames share {ENOUGH} points off the subject, at best {best}"
        raise NoPathError("clip", "camera path", reason, "too smooth, too few frames, or too little but the subject")
    moved = max(pair.moved for pair in witnesses)
    if moved < STILL:
        reason = f"the camera stands still: points move by at most {100 * moved:.2f} % of the frame's width"
        raise NoPathError("clip", "camera path", reason, "depth and path need a camera that moves")
    clearest = sorted((pair.parallax for pair in witnesses), reverse=True)[: max(1, len(witnesses) // 4)]
    share = fmean(clearest)
    if share < SHARE:
        reason = f"no parallax: a homography of each pair of frames explains {100 * (1 - share):.0f} % of their points"
        raise NoPathError(
            "clip", "camera path", reason, "the camera turns or zooms without moving, or all is flat or far"
        )
