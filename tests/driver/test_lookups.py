"""What is looked up along a clip: few values of each sample, and the cheapest of all together."""

import numpy as np

from cltransfer.driver.closed_form import DISTANCES
from cltransfer.driver.lookups import _cheapest, cheapest_along


def test_what_one_frame_found_is_looked_up_beside_it() -> None:
    """The first frames see a gap that the coarse lookups miss, and a wide valley elsewhere; the last see the gap."""
    values, slope = DISTANCES.log().numpy(), np.abs(np.arange(24) - 16.0)
    costs = np.stack([1.0 + 0.1 * slope] * 3 + [6.0 + 0.0 * slope] * 3)
    costs[:, 8] = 0.5
    costs[3:, 9] = 3.0  # leads there from the coarse ones
    known = np.zeros(costs.shape, bool)

    def look_up(k: int, tried: np.ndarray) -> np.ndarray:
        known[k] |= tried
        return costs[k, tried]

    assert cheapest_along(look_up, 6, values, 1.0).tolist() == [8] * 6
    assert known.sum(1).max() <= 24 / 2 + 2


def test_a_single_frame_sees_a_gap_that_coarse_lookups_miss() -> None:
    costs = 1.0 + 0.1 * np.abs(np.arange(24) - 16.0)
    costs[2] = 0.2
    assert cheapest_along(lambda k, tried: costs[tried], 1, DISTANCES.log().numpy(), 1.0).tolist() == [2]


def test_a_depth_that_suits_the_first_frame_alone_is_not_taken() -> None:
    costs = np.array([[0.0, 0.1], [1.0, 0.0], [1.0, 0.0], [1.0, 0.0]])
    assert _cheapest(costs, np.array([0.0, 1.0]), 5.0).tolist() == [1, 1, 1, 1]


def test_a_steady_move_costs_no_more_than_standing_still() -> None:
    costs = 0.2 * np.abs(np.arange(4)[:, None] - np.arange(4))
    assert _cheapest(costs, np.arange(4.0), 5.0).tolist() == [0, 1, 2, 3]


def test_two_samples_take_the_cheapest_each() -> None:
    assert _cheapest(np.array([[0.0, 1.0], [1.0, 0.0]]), np.array([0.0, 1.0]), 5.0).tolist() == [0, 1]
