"""What is looked up along a clip: few values of each sample, and the cheapest of all together."""

import numpy as np
import pytest

from cltransfer.driver.closed_form import DISTANCES
from cltransfer.driver.lookups import STEP, cheapest, cheapest_along

VALUES = DISTANCES.log().numpy()
STEPS = np.arange(len(VALUES)) / STEP


def test_what_one_frame_found_is_looked_up_beside_it() -> None:
    """The first frames see a gap that the coarse lookups miss, and a wide valley elsewhere; the last see the gap."""
    slope = np.abs(STEPS - 16)
    costs = np.stack([1.0 + 0.1 * slope] * 3 + [6.0 + 0.0 * slope] * 3)
    costs[:, 8 * STEP] = 0.5
    costs[3:, 9 * STEP] = 3.0  # leads there from the coarse ones
    known = np.zeros(costs.shape, bool)

    def look_up(k: int, tried: np.ndarray) -> np.ndarray:
        known[k] |= tried
        return costs[k, tried]

    assert cheapest_along(look_up, 6, VALUES, 1.0)[1].tolist() == [8 * STEP] * 6
    between = 2 * (STEP - 1)
    assert known[:3].sum(1).max() <= 24 / 2 + 2 + between  # those that nothing is wrong with


@pytest.mark.parametrize("lowest", [3.4, 1.8])
@pytest.mark.parametrize("samples", [1, 4])
def test_where_no_step_is_good_those_between_are_looked_up(samples: int, lowest: float) -> None:
    """A post before the lens hides the person from every step but not from between two of them."""
    costs = np.stack([8.0 - 0.1 * STEPS] * samples)
    costs[:, 16 * STEP], costs[:, 15 * STEP + 1 : 16 * STEP] = lowest, 0.5
    taken = cheapest_along(lambda k, tried: costs[k, tried], samples, VALUES, 1.0)[1]
    assert set(taken.tolist()) <= {15 * STEP + 1, 15 * STEP + 2}


def test_what_is_little_better_between_steps_is_not_taken() -> None:
    """It would bend the path for nothing where every distance is poor."""
    costs = np.stack([8.0 - 0.1 * STEPS] * 4)
    costs[:, 16 * STEP], costs[:, 15 * STEP + 1 : 16 * STEP] = 3.4, 2.0
    taken = cheapest_along(lambda k, tried: costs[k, tried], 4, VALUES, 1.0)[1]
    assert taken.tolist() == [16 * STEP] * 4


def test_what_a_neighbour_takes_between_steps_is_not_looked_up_again_where_it_was_no_gap() -> None:
    costs = 0.1 * np.abs(STEPS - 16) + np.array([[1.2], [8.0]])
    costs[0, 16 * STEP + 1], costs[1, 16 * STEP + 1] = 0.9, 0.5
    asked: list[tuple[int, int]] = []

    def look_up(k: int, tried: np.ndarray) -> np.ndarray:
        asked.extend((k, int(step)) for step in np.flatnonzero(tried))
        return costs[k, tried]

    cheapest_along(look_up, 2, VALUES, 1.0)
    assert (0, 16 * STEP + 1) in asked
    assert len(set(asked)) == len(asked)


def test_where_a_step_is_good_nothing_between_is_looked_up() -> None:
    known = np.zeros((4, len(VALUES)), bool)

    def look_up(k: int, tried: np.ndarray) -> np.ndarray:
        known[k] |= tried
        return 0.1 + np.abs(STEPS - 11)[tried]

    cheapest_along(look_up, 4, VALUES, 1.0)
    assert not known[:, np.arange(len(VALUES)) % STEP > 0].any()


def test_a_single_frame_sees_a_gap_that_coarse_lookups_miss() -> None:
    costs = 1.0 + 0.1 * np.abs(STEPS - 16)
    costs[2 * STEP] = 0.2
    assert cheapest_along(lambda k, tried: costs[tried], 1, VALUES, 1.0)[1].tolist() == [2 * STEP]


def test_a_depth_that_suits_the_first_frame_alone_is_not_taken() -> None:
    costs = np.array([[0.0, 0.1], [1.0, 0.0], [1.0, 0.0], [1.0, 0.0]])
    chosen, total = cheapest(costs, np.array([[0.0], [1.0]]), 5.0)
    assert chosen.tolist() == [1, 1, 1, 1]
    assert total == pytest.approx(0.1 / 4)


def test_a_steady_move_costs_no_more_than_standing_still() -> None:
    costs = 0.2 * np.abs(np.arange(4)[:, None] - np.arange(4))
    chosen, total = cheapest(costs, np.arange(4.0)[:, None], 5.0)
    assert chosen.tolist() == [0, 1, 2, 3]
    assert total == 0


def test_a_bend_costs_in_every_direction() -> None:
    places = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 2.0]])
    costs = np.full((3, 3), 9.0)
    costs[0, 0], costs[1, 1], costs[2, 2] = 0.3, 0.3, 0.3
    assert cheapest(costs, places, 0.1)[1] == pytest.approx((0.9 + 0.1 * (2 + 2)) / 3)


def test_what_was_not_looked_up_is_not_taken() -> None:
    costs = np.array([[np.inf, 1.0], [2.0, np.inf], [np.inf, 3.0]])
    chosen, total = cheapest(costs, np.array([[0.0], [1.0]]), 0.0)
    assert chosen.tolist() == [1, 0, 1]
    assert total == 2


def test_two_samples_take_the_cheapest_each() -> None:
    chosen, total = cheapest(np.array([[0.0, 1.0], [1.0, 0.5]]), np.array([[0.0], [1.0]]), 5.0)
    assert chosen.tolist() == [0, 1]
    assert total == 0.25
