"""Where a person was while a detector did not see them: between where they were before and after."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .join_persons import MAX_GAP, RATE, SOON
from .persons import CROSSING, overlap


def filled(box: np.ndarray, times: np.ndarray | None = None, found: Sequence[np.ndarray] = ()) -> np.ndarray:
    """``box`` (N, 5) of one person, in frames that lack it where it was on the way, with score 0; NaN elsewhere.

    Between two frames that have it, at most ``MAX_GAP`` apart or with one frame between them, it goes straight from one
    to the other; before the first and after the last it stays for ``SOON``, or one frame. It is NaN too where somebody
    else stands there, who would be read. Whoever reads there has to say whether anybody is.

    Args:
        box: x, y, width, height [px], score; NaN where nobody was seen.
        times: of the frames, (N,) [s], increasing; None takes ``RATE`` a second.
        found: boxes (P, 5) of all who were seen in each frame, the others where ``box`` lacks it; none by default.

    >>> filled(np.array([[0.0] * 5, [np.nan] * 5, [2.0] * 5]))[:, 0].tolist()
    [0.0, 1.0, 2.0]
    """
    frames, seen = np.arange(len(box)), np.flatnonzero(np.isfinite(box[:, 0]))
    if len(seen) == 0:
        return box
    times = frames / RATE if times is None else times
    after = np.searchsorted(seen, frames)
    first, last = seen[np.maximum(after - 1, 0)], seen[np.minimum(after, len(seen) - 1)]
    between = (times[last] - times[first] <= MAX_GAP) | (last - first <= 2)
    beside = (np.abs(times - times[first]) <= SOON) | (np.abs(frames - first) <= 1)
    known = np.where(first == last, beside, between)
    places = np.stack([np.interp(times, times[seen], column[seen]) for column in box.T], axis=1)
    places[:, 4] = 0
    guessed = np.where(np.isfinite(box), box, np.where(known[:, None], places, np.nan))
    for i, others in enumerate(found):
        if i not in seen and (overlap(guessed[i : i + 1], others) > CROSSING).any():
            guessed[i] = np.nan
    return guessed
