"""Lookups from aside: where they gain all along a clip they are taken, and where they do not they cost little."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from cltransfer.driver.closed_form import DISTANCES, LITTLE
from cltransfer.driver.lookups import STEP, cheapest_along
from cltransfer.driver.lookups_aside import FIRST, GAINS, HOPEFUL, cheapest_aside

LOGS = DISTANCES.log().numpy()
STEPS = np.arange(len(LOGS)) / STEP


class Landscape:
    """Costs (W + 1, S, K) of way 0, straight, and those aside; what is asked of them is counted."""

    def __init__(self, samples: int, rate: float = 1.0) -> None:
        self.rate = rate
        self.costs = np.full((len(LITTLE) + 1, samples, len(LOGS)), 5.0)
        self.costs[0] = 2.0 + 0.1 * np.abs(STEPS - 12)
        self.asked: list[tuple[int, int, int]] = []

    def chosen(self) -> tuple[list[int], NDArray]:
        """Which way each sample takes, and which step of the distances."""
        way, at = cheapest_aside(self._look_up, self.straight(), LOGS, LITTLE, self.rate)
        return way.tolist(), at

    def straight(self) -> tuple[NDArray, NDArray]:
        """What distances cost straight, and which are chosen so."""
        return cheapest_along(lambda k, tried: self.costs[0, k, tried], self.costs.shape[1], LOGS, self.rate)

    def _look_up(self, k: int, way: int, tried: NDArray) -> NDArray:
        self.asked += [(k, way, int(step)) for step in tried]
        return self.costs[way, k, tried]


@pytest.mark.parametrize("samples", [1, 2, 3, 4, 8])
def test_a_way_that_suits_the_whole_clip_is_taken(samples: int) -> None:
    scene = Landscape(samples)
    scene.costs[2] = 0.5 + 0.1 * np.abs(STEPS - 14)
    way, at = scene.chosen()
    assert way == [2] * samples
    assert at.tolist() == [14 * STEP] * samples
    assert len(set(scene.asked)) == len(scene.asked)


@pytest.mark.parametrize("samples", [1, 4, 8])
def test_where_none_gains_the_costliest_of_either_half_have_looked_alone(samples: int) -> None:
    scene = Landscape(samples)
    scene.costs[:, samples // 2 - 1] += 0.2
    scene.costs[:, samples - 1] += 0.2
    way, at = scene.chosen()
    assert way == [0] * samples
    assert at.tolist() == [12 * STEP] * samples
    assert {k for k, _, _ in scene.asked} == {max(0, samples // 2 - 1), samples - 1}
    assert len(scene.asked) == min(samples, 2) * len(LITTLE) * len(FIRST)


def test_all_look_only_where_the_costliest_gain_enough() -> None:
    for gain, looks in ((HOPEFUL - 0.01, False), (HOPEFUL + 0.01, True)):
        scene = Landscape(4)
        scene.costs[1] = 2.0 - gain
        scene.chosen()
        assert (len({k for k, _, _ in scene.asked}) > 2) == looks


def test_what_one_sample_alone_gains_bends_the_clip_for_nothing() -> None:
    scene = Landscape(8)
    scene.costs[:, 5] += 0.1
    scene.costs[3, 5] = 1.0
    assert scene.chosen()[0] == [0] * 8


def test_a_distance_that_nobody_else_takes_hides_no_way_aside() -> None:
    """The costliest would be cheaper far away too, where the others cannot follow."""
    scene = Landscape(8, rate=5 / 3)
    scene.costs[0] = 6.0
    scene.costs[0, :, 12 * STEP], scene.costs[2] = 1.0, 0.5
    scene.costs[0, [2, 6], 12 * STEP], scene.costs[0, [2, 6], 21 * STEP], scene.costs[2, [2, 6]] = 3.0, 1.9, 2.0
    assert scene.straight()[1].tolist() == [12 * STEP] * 8
    assert scene.chosen()[0] == [2] * 8


@pytest.mark.parametrize("first", [0.0, 3.0])
def test_a_part_of_the_clip_goes_aside_alone_where_that_gains_more_than_it_bends(first: float) -> None:
    scene = Landscape(8)
    scene.costs[0, :4] -= first / 2
    scene.costs[4, 4:] = 0.1
    way, _ = scene.chosen()
    assert way[5:] == [4] * 3
    assert set(way[:3]) <= {0}


def test_a_clip_that_moves_away_is_followed_aside() -> None:
    """Every sample looks as much nearer or farther as those that have looked, and around what it finds."""
    scene = Landscape(8)
    moves = 4 + 2 * np.arange(8)
    scene.costs[0] = 2.0 + 0.3 * np.abs(STEPS - moves[:, None])
    scene.costs[1] = 0.3 + 0.3 * np.abs(STEPS - moves[:, None] - 1)
    way, at = scene.chosen()
    assert way == [1] * 8
    assert at.tolist() == (STEP * (moves + 1)).tolist()


def test_it_never_takes_what_costs_more() -> None:
    random = np.random.default_rng(0)
    taken = 0
    for _ in range(30):
        scene = Landscape(6, rate=0.0)
        scene.costs = random.uniform(0.5, 3.0, scene.costs.shape) * random.uniform(0.2, 1.5, (5, 1, 1))
        costs, chosen = scene.straight()
        way, at = scene.chosen()
        every = np.arange(6)
        gain = costs[every, chosen].mean() - scene.costs[way, every, at].mean()
        assert gain >= GAINS or way == [0] * 6
        taken += any(way)
    assert 5 < taken < 30
