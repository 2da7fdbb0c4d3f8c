"""A path at a frame rate: what lies between the frames that were searched."""

from __future__ import annotations

import torch

from ..errors import UsageError
from ..trajectory import FRAME_LIMIT, Trajectory

MOST_FPS = 240
SLACK = 0.05  # of a frame that a path may be short of its last: times are rounded, and 23.976 is not 24000 / 1001


def at_rate(trajectory: Trajectory, fps: float | None, most: int = FRAME_LIMIT) -> Trajectory:
    """The path at ``fps`` from its first frame on, the camera led smoothly through those it has; None: as it is.

    Args:
        trajectory: the path.
        fps: frames a second.
        most: frames that there may be.

    Raises:
        UsageError: ``fps`` is out of range or makes too many frames.
    """
    if fps is None:
        return trajectory
    if not 0 < fps <= MOST_FPS:
        raise UsageError("", "--fps", f"expected a rate in (0, {MOST_FPS}], got {fps:g}")
    start, end = float(trajectory.times[0]), float(trajectory.times[-1])
    count = int((end - start) * fps + SLACK) + 1
    if count > most:
        raise UsageError("", "--fps", f"{fps:g} makes {count} frames of {end - start:.1f} s, at most {most}")
    return trajectory.at((start + torch.arange(count, dtype=torch.float64) / fps).clamp(max=end))
