"""Lookups along a clip: which of the same values each sample takes, from few of them looked up."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

COARSE = 9  # steps of values that are looked up first
STEP = 3  # the same around the cheapest path, and everywhere where that is poor; in steps of one where it is not good
GAP = 0.5  # of what the cheapest step costs, above which nothing between two steps is taken for a gap
POOR = 3.0  # total of a frame, without movement, above which all steps are looked up
POORER, LEAST = 3.0, 1.0  # the same: times the median of the frames looked up, no less than that, which is not good


def cheapest_along(
    look_up: Callable[[int, NDArray], NDArray], samples: int, values: NDArray, rate: float
) -> tuple[NDArray, NDArray]:
    """Costs (S, K) of K values and which of them each sample takes, (S,), see :func:`cheapest`.

    ``look_up(k, tried)`` costs evaluations; what was not looked up costs infinitely much.

    First some for every sample, then those about the cheapest path, all steps where that is poor, those between steps
    where it is not good, and in the end what its neighbours take: a narrow gap that one has found would be left again
    where the next one has not looked. A single sample, for which all frames are to stand still, looks up all steps at
    once: no other would tell of a narrow gap.
    """
    known, chosen = np.full((samples, len(values)), np.inf), np.zeros(samples, int)
    costs = known.copy()
    first = (_steps,) if samples == 1 else (_coarse, _beside, _rest)
    for wanted in (*first, _between, *[_likewise] * (samples - 1)):
        asked = wanted(costs, chosen)
        if wanted is _likewise and not (asked & np.isinf(costs)).any():
            break
        for k, tried in enumerate(asked & np.isinf(known)):
            if tried.any():
                known[k, tried] = look_up(k, tried)
        costs = np.where(asked, known, costs)
        if wanted is _between:
            costs = _with_gaps(costs, chosen)
        chosen = cheapest(costs, values[:, None], rate)[0]
    return costs, chosen


def _steps(costs: NDArray, chosen: NDArray) -> NDArray:
    """All steps of costs (S, K), bool, whatever was ``chosen`` (S,)."""
    return np.broadcast_to(np.arange(costs.shape[1]) % STEP == 0, costs.shape)


def _coarse(costs: NDArray, chosen: NDArray) -> NDArray:
    """Those of costs (S, K) that are looked up first, bool, whatever was ``chosen`` (S,)."""
    return np.broadcast_to(np.arange(costs.shape[1]) % COARSE == 0, costs.shape)


def _beside(costs: NDArray, chosen: NDArray) -> NDArray:
    """Steps of (S, K) nearer to what was ``chosen`` (S,) than the next that was looked up first."""
    return _steps(costs, chosen) & _within(COARSE, costs, chosen)


def _rest(costs: NDArray, chosen: NDArray) -> NDArray:
    """All steps of (S, K) where what was ``chosen`` (S,) is poor: what hides the person leaves a narrow gap."""
    return _steps(costs, chosen) & _poor(_of(costs, chosen))


def _between(costs: NDArray, chosen: NDArray) -> NDArray:
    """Those of (S, K) less than a step from what was ``chosen`` (S,), where that costs more than :data:`LEAST`."""
    return _within(STEP, costs, chosen) & (_of(costs, chosen) > LEAST)


def _with_gaps(costs: NDArray, chosen: NDArray) -> NDArray:
    """Costs (S, K), infinite between steps but for gaps: little better than the ``chosen`` (S,) it is no way through.

    >>> _with_gaps(np.array([[8.0, 7.5, 0.6, 7.0]]), np.array([3])).tolist()
    [[8.0, inf, 0.6, 7.0]]
    """
    gap = costs <= GAP * _of(costs, chosen)
    return np.where(_steps(costs, chosen) | gap, costs, np.inf)


def _within(steps: int, costs: NDArray, chosen: NDArray) -> NDArray:
    """Those of (S, K) less than ``steps`` from what was ``chosen`` (S,)."""
    return np.abs(np.arange(costs.shape[1]) - chosen[:, None]) < steps


def _of(costs: NDArray, chosen: NDArray) -> NDArray:
    """Costs (S, 1) of what was ``chosen`` (S,)."""
    return costs[np.arange(len(costs)), chosen][:, None]


def _likewise(costs: NDArray, chosen: NDArray) -> NDArray:
    """Those of (S, K) that were ``chosen`` (S,) by the sample before and the one after."""
    wanted = np.zeros(costs.shape, bool)
    wanted[np.arange(1, len(costs)), chosen[:-1]] = True
    wanted[np.arange(len(costs) - 1), chosen[1:]] = True
    return wanted


def _poor(costs: NDArray) -> NDArray:
    """Frames bool whose cost is high, or far above that of the others.

    >>> _poor(np.array([0.2, 0.3, 1.1, 0.4])).tolist()
    [False, False, True, False]
    """
    return costs > min(POOR, max(LEAST, POORER * float(np.median(costs))))


def cheapest(costs: NDArray, places: NDArray, rate: float) -> tuple[NDArray, float]:
    """Which of K values (S,) each of S samples takes, so that costs (S, K) and ``rate`` times every bend are least.

    And what that comes to, a sample. A bend is a second difference of ``places`` (K, C), what the values are: a steady
    move is as good as standing still, since the reference may move too. Samples count as evenly spaced.

    >>> cheapest(np.array([[0.0, 0.1], [1.0, 0.0], [1.0, 0.0]]), np.array([[0.0], [1.0]]), 5.0)[0].tolist()
    [1, 1, 1]
    """
    if len(costs) < 3:
        return costs.argmin(1), float(costs.min(1).mean())
    known = [np.flatnonzero(np.isfinite(cost)) for cost in costs]
    there = [places[k].T[:, :, None, None] for k in known]  # (C, K, 1, 1)
    before, now = costs[0][known[0]], costs[1][known[1]]
    best, back = before[:, None] + now, []  # (K, K) of the last two
    for s in range(2, len(costs)):
        first, then, last = there[s - 2], there[s - 1].swapaxes(1, 2), there[s].swapaxes(1, 3)
        bend = sum(np.abs(a - 2 * b + c) for a, b, c in zip(first, then, last, strict=True))  # (K, K, K)
        ways = best[:, :, None] + rate * bend
        back.append(ways.argmin(0))
        best = ways.min(0) + costs[s][known[s]]
    then, last = np.unravel_index(best.argmin(), best.shape)
    chosen = [int(last), int(then)]
    for step in reversed(back):
        chosen.append(int(step[chosen[-1], chosen[-2]]))
    return np.array([k[i] for k, i in zip(known, chosen[::-1], strict=True)]), float(best.min()) / len(costs)
