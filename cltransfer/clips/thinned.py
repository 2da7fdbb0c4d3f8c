"""Which frames are taken of a clip, or of a path, where fewer are wanted: evenly in time, not by their number."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor


def evenly(shown: Tensor, wanted: int | None) -> Tensor:
    """Indices (K,) int64 of ``wanted`` frames nearest to evenly spaced times, each another one; None takes all.

    >>> evenly(torch.tensor([0.0, 0.1, 0.2, 1.0, 2.0]), 3)
    tensor([0, 3, 4])
    """
    count = len(shown)
    if wanted is None or wanted >= count:
        return torch.arange(count)
    times = shown.numpy()
    even = np.linspace(times[0], times[-1], wanted)
    order = np.arange(wanted)
    distinct = np.maximum.accumulate(nearest(times, even) - order) + order  # pushed on where two would be the same
    return torch.from_numpy(np.minimum(distinct, count - wanted + order))


def nearest(times: np.ndarray, moments: np.ndarray) -> np.ndarray:
    """Index (M,) of the nearest of ``times`` (N,), increasing, for each of ``moments`` (M,), the earlier of two.

    No matrix of all distances is made: two clips of a quarter of an hour would need gigabytes.
    """
    after = np.searchsorted(times, moments).clip(max=len(times) - 1)
    before = np.maximum(after - 1, 0)
    return np.where(moments - times[before] <= times[after] - moments, before, after)
