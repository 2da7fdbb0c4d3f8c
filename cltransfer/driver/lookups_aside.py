"""Lookups from aside: a little higher or lower, say, another part of what is behind the person is seen.

The depth of a layer jumps where another part of what is in it gets the larger, so that one view costs a tenth of what
the next one does. From where a reference was read all distances may be on the dear side of such a jump, while a
tolerance aside most of them are on the other.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .lookups import STEP, cheapest

FIRST = (-4, -1, 1, 4)  # steps from the distance chosen, that the costliest sample of either half looks at first
HOPEFUL = 0.15  # total of theirs in the mean, that this has to gain for the others to look from there too
GAINS = 0.1  # total of a frame, bends counted, that all have to gain in the mean
STIFF = 3.0  # what a turn about the person [rad] costs, of what the log of their distance does
ROUNDS = 8  # of looking around what was found, at most


def cheapest_aside(
    look_up: Callable[[int, int, NDArray], NDArray],
    straight: tuple[NDArray, NDArray],
    logs: NDArray,
    ways: NDArray,
    rate: float,
) -> tuple[NDArray, NDArray]:
    """Which way (S,) and which of K distances (S,) each sample takes; way 0 is straight, as found without this.

    The costliest sample of either half looks from every way, about the distance chosen; where that gains all look
    around what those have found, and around what they find.

    Args:
        look_up: what sample k costs from a way, counted from 1, at some distances, ``look_up(k, way, tried)``.
        straight: costs (S, K) from no way aside, infinite where it was not looked, and what is chosen there (S,).
        logs: of the K distances.
        ways: azimuth and elevation (W, 2) [rad] aside.
        rate: of bends, see :func:`~.lookups.cheapest`.
    """
    known, chosen = straight
    samples, steps = known.shape
    turns = np.concatenate([np.zeros((1, 2)), ways]).repeat(steps, axis=0)  # of each cell
    places = np.column_stack([np.tile(logs, len(ways) + 1), STIFF * turns])
    cells = _Cells(look_up, np.full((samples, len(places)), np.inf), steps)
    cells.costs[:, :steps] = known
    few = _costliest(known[np.arange(samples), chosen])
    best = np.array([cells.first(int(k), int(chosen[k])) for k in few])
    if float((known[few, chosen[few]] - cells.costs[few, best]).mean()) < HOPEFUL:
        return np.zeros_like(chosen), chosen
    wanted = _between(few, best, chosen, steps)
    for _ in range(ROUNDS):
        new = sum(cells.look(k, some) for k, some in enumerate(wanted))
        found, total = cheapest(cells.costs, places, rate)
        if not new:
            break
        wanted = [_around(found, k, steps) for k in range(samples)]
    if cheapest(known, logs[:, None], rate)[1] - total < GAINS:
        return np.zeros_like(chosen), chosen
    return found // steps, found % steps


@dataclass(frozen=True)
class _Cells:
    """What every distance costs from every way: cell ``way * steps + distance``, those that are straight first.

    Args:
        look_up: as of :func:`cheapest_aside`.
        costs: of S samples, (S, (1 + W) * steps), infinite where it was not looked.
        steps: how many distances there are.
    """

    look_up: Callable[[int, int, NDArray], NDArray]
    costs: NDArray
    steps: int

    def look(self, k: int, cells: NDArray) -> int:
        """How many of the ``cells`` of sample ``k`` are new; they are looked at."""
        new = cells[np.isinf(self.costs[k, cells])]
        for way in np.unique(new // self.steps):
            here = new[new // self.steps == way]
            self.costs[k, here] = self.look_up(k, int(way), here % self.steps)
        return len(new)

    def first(self, k: int, chosen: int) -> int:
        """The cheapest cell aside that a first look about the distance ``chosen`` finds, or that where none gains."""
        ways = np.arange(1, self.costs.shape[1] // self.steps)
        near = _kept(chosen + STEP * np.array(FIRST), self.steps)
        self.look(k, (self.steps * ways[:, None] + near).ravel())
        best = self.steps + int(self.costs[k, self.steps :].argmin())
        return best if self.costs[k, best] < self.costs[k, chosen] else chosen


def _costliest(costs: NDArray) -> NDArray:
    """The costliest sample of either half of (S,), or the only one there is."""
    half = len(costs) // 2
    return np.array([int(part.argmax()) + at for part, at in ((costs[:half], 0), (costs[half:], half)) if len(part)])


def _between(few: NDArray, best: NDArray, chosen: NDArray, steps: int) -> list[NDArray]:
    """Cells aside that each sample looks at first: from the ways of the ``few`` about it, as much nearer or farther."""
    every = np.arange(len(chosen))
    at = chosen + np.interp(every, few, best % steps - chosen[few]).round().astype(int)
    sides = (np.searchsorted(few, every, "right") - 1).clip(0), np.searchsorted(few, every).clip(max=len(few) - 1)
    ways = np.stack([best[side] // steps for side in sides], axis=1)  # (S, 2)
    return [np.concatenate([_beside(way, at[k], steps) for way in np.unique(ways[k])]) for k in every]


def _around(found: NDArray, k: int, steps: int) -> NDArray:
    """Cells aside, of what sample ``k`` has found (S,) and a step nearer and farther, and of those beside it."""
    own = _beside(found[k] // steps, found[k] % steps, steps)
    cells = np.unique(np.concatenate([own, found[max(k - 1, 0) : k + 2]]))
    return cells[cells >= steps]


def _beside(way: int, at: int, steps: int) -> NDArray:
    """Cells of a distance and those a step nearer and farther from a way aside, none of way 0."""
    return way * steps + _kept(at + STEP * np.array((-1, 0, 1)), steps if way else 0)


def _kept(distances: NDArray, steps: int) -> NDArray:
    """Those of some distances that there are."""
    return distances[(distances >= 0) & (distances < steps)]
