"""Values along a clip: where its frames stand in time, what is filtered along them, and runs of them.

What moves steadily does so however the frames are spaced.
"""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor
from torch.nn.functional import pad

from .errors import InputError

SHORTEST, ROUNDED = 1e-6, 5e-7  # [s] between two frames at least; by which it may be less, counted from 1970
LONGEST = 1e6  # [s] from the first frame to the last, as an mp4 holds with a clock of milliseconds
LATEST = 1e10  # [s] of any time: what is counted from 1970 lies below, and milliseconds can be told apart
MEDIAN = 5  # frames
BLOCK = 1024  # frames that are filtered together
REACH = 9.0  # standard deviations of the filter: what is farther counts for less than numbers tell
EVEN = 1e-3  # of the usual spacing, by which evenly spaced frames may differ
WIDEST = 4.0  # times the usual spacing that a pause counts as at most, and its part that a burst does at least


def check_times(where: str | Path, field: str, times: Tensor, hint: str = "") -> None:
    """Refuse times (N,) [s], increasing, that are none of frames.

    Raises:
        InputError: they are not finite, far beyond any clock, or two of them are too close to be told apart.
    """
    if not bool((times.abs() <= LATEST).all()):
        raise InputError(where, field, f"expected finite numbers within {LATEST:.0e} s of 0", hint)
    steps = times.diff()
    if len(times) > 1 and float(steps.min()) < SHORTEST - ROUNDED:
        reason = f"expected {SHORTEST:g} s and more between frames, frame {int(steps.argmin()) + 1} is shown"
        raise InputError(where, field, f"{reason} {float(steps.min()):.3g} s after the one before", hint)


def check_span(where: str | Path, field: str, times: Tensor, hint: str = "") -> None:
    """Refuse times (N,) [s], increasing, that an mp4 does not hold.

    Raises:
        InputError: the last is too long after the first.
    """
    span = float(times[-1] - times[0])
    if span > LONGEST:
        reason = f"expected at most {LONGEST:g} s from the first frame to the last, got {span:g} s"
        raise InputError(where, field, reason, hint)


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


def along(x: Tensor, frames: float, at: Tensor | None = None) -> Tensor:
    """x (N, D) filtered along N by a Gaussian of standard deviation ``frames``; NaN rows stay and count for nothing.

    Its frames stand ``at`` (N,), see :func:`places`, or are evenly spaced.
    """
    index = counted(len(x), at).to(x.dtype)
    parts = []
    for first in range(0, len(x), BLOCK):  # all frames of a long clip against all would take its length squared
        block = index[first : first + BLOCK]
        low, high = torch.searchsorted(index, torch.stack([block[0] - REACH * frames, block[-1] + REACH * frames]))
        near = slice(0, len(x)) if len(x) <= BLOCK else slice(int(low), int(high))
        parts.append(_line(x[first : first + BLOCK], block, x[near], index[near], frames))
    return torch.cat(parts) if parts else x


def _line(x: Tensor, at: Tensor, near: Tensor, near_at: Tensor, frames: float) -> Tensor:
    """:func:`along` of frames x (N, D) by those ``near`` them (M, D), which stand at (M,)."""
    offset = near_at[None] - at[:, None]  # (N, M)
    weight = torch.exp(-0.5 * (offset / frames) ** 2)
    there = torch.isfinite(near)
    # a line is fitted under the window, so that a steady motion and its ends stay what they are
    filled = torch.where(there, near, 0.0)
    s0, s1, s2 = (torch.einsum("nm,md->nd", weight * offset**k, there.to(x)) for k in (0, 1, 2))
    t0, t1 = (torch.einsum("nm,md->nd", weight * offset**k, filled) for k in (0, 1))
    spread = s0 * s2 - s1**2
    line = (s2 * t0 - s1 * t1) / spread.clamp_min(1e-9)
    return torch.where(torch.isfinite(x), torch.where(spread > 1e-6, line, t0 / s0.clamp_min(1e-9)), x)


def runs(frames: Tensor) -> list[tuple[int, int]]:
    """Of ``frames`` (N,) bool that follow one another the first, and the one after the last.

    >>> runs(torch.tensor([True, True, False, True]))
    [(0, 2), (3, 4)]
    """
    edges = pad(frames.int(), (1, 1)).diff().nonzero()
    return [(int(first), int(last)) for first, last in edges.reshape(-1, 2)]


def running_median(x: Tensor) -> Tensor:
    """Running median of x (N, D) over up to MEDIAN frames, fewer at the ends."""
    reach = MEDIAN // 2
    rows = [x[max(0, i - min(reach, i, len(x) - 1 - i)) : i + min(reach, i, len(x) - 1 - i) + 1] for i in range(len(x))]
    return torch.stack([row.median(0).values for row in rows])
