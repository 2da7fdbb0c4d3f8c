"""Where the frames of a clip stand in time, so that what moves steadily does so however they are spaced."""

from __future__ import annotations

import torch
from torch import Tensor

EVEN = 1e-3  # of the usual spacing, by which evenly spaced frames may differ
WIDEST = 4.0  # times the usual spacing that a pause counts as at most, and its part that a burst does at least


def places(times: Tensor) -> Tensor | None:
    """Places of N frames along their clip, in frames of its usual spacing; None where they are evenly spaced.

    Every second or third frame of a clip, which is what thinning it leaves, is not evenly spaced: a curve through such
    frames by their number would run slower where they are dense.

    >>> places(torch.tensor([0.0, 0.1, 0.2, 0.4, 0.5])).round(decimals=3).tolist()
    [0.0, 1.0, 2.0, 4.0, 5.0]

    Args:
        times: (N,) [s], increasing.

    Returns:
        (N,) float64, increasing.
    """
    if len(times) < 3:
        return None
    steps = times.double().diff()
    steps = (steps / steps.quantile(0.5)).clamp(1 / WIDEST, WIDEST)
    if bool(((steps - 1).abs() < EVEN).all()):
        return None
    return torch.cat([steps.new_zeros(1), steps.cumsum(0)])


def counted(frames: int, given: Tensor | None = None) -> Tensor:
    """The places (N,) that are ``given``, or those of N frames that are evenly spaced."""
    return torch.arange(frames, dtype=torch.float64) if given is None else given
