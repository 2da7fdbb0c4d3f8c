"""What leads a path across jumps of a loss: the residual beyond, and a toll by the way that is left."""

import pytest
import torch
from torch import Tensor

from cltransfer.driver.jumps import GAIN, MARGIN, NEAR, Jumps, jumps_of
from cltransfer.driver.spline import Local
from cltransfer.pipeline.objective import Across

# three frames with two residuals; the second one jumps in the second frame, is across in the third
RESIDUALS = torch.tensor([[0.3, 0.1], [0.2, -1.5], [0.1, 0.2]]).double()
ACROSS = Across(
    RESIDUALS,
    torch.tensor([[0.3, 0.1], [0.2, 0.5], [0.1, 0.2]]).double(),
    torch.tensor([[0.0, -1.2], [0.0, 0.4], [0.0, -0.7]]).double(),
)
NONE = torch.zeros_like(RESIDUALS, dtype=torch.bool)


def jumps() -> Jumps:
    found = jumps_of(ACROSS, NONE)
    assert found is not None
    return found


def measured(slope: float, values: Tensor | None = None) -> Local:
    """What was measured, by one direction that brings the jump nearer by ``slope``, and the first residual up by 1."""
    values = jumps().values(ACROSS) if values is None else values
    jacobian = torch.zeros(3, 4, 1, dtype=torch.float64)
    jacobian[:, 0], jacobian[:, 1], jacobian[:, 2], jacobian[:, 3] = 1.0, 5.0, 0.25, -slope
    return Local(values, jacobian, torch.tensor([0, 1]), torch.tensor([False, True, False, False]))


def test_a_frame_is_led_where_a_jump_is_near_and_saves() -> None:
    found = jumps()
    assert found.columns.tolist() == [1]
    assert found.led.tolist() == [[False], [True], [False]]
    assert float(found.gain[1]) == 1.0
    assert found.worth == pytest.approx(1 / 3)


@pytest.mark.parametrize(
    ("beyond", "far"),
    [(0.5, NEAR + 0.01), (-1.5 + GAIN - 0.01, 0.4), (0.5, 0.0), (-1.5 + GAIN + 0.01, 0.4)],
    ids=["far", "saves little", "there", "saves little of the whole clip"],
)
def test_none_is_led_where_it_is_far_or_saves_little(beyond: float, far: float) -> None:
    across = Across(RESIDUALS, ACROSS.beyond.clone(), ACROSS.far.clone())
    across.beyond[1, 1], across.far[1, 1] = beyond, far
    assert jumps_of(across, NONE) is None


def test_what_was_tried_is_not_tried_again() -> None:
    tried = NONE.clone()
    tried[1, 1] = True
    assert jumps_of(ACROSS, tried) is None


def test_the_residual_beyond_leads_and_a_toll_that_falls_to_nothing_a_margin_beyond() -> None:
    there = jumps().local(measured(2.0))
    toll = 1.0 / (0.4 + MARGIN)
    expected = torch.tensor([[0.3, 0.1, 0.0], [0.2, 0.5, 1.0], [0.1, 0.2, 0.0]]).double()
    torch.testing.assert_close(there.residuals, expected)
    torch.testing.assert_close(there.jacobian[1, :, 0], torch.tensor([1.0, 0.25, -2.0 * toll]).double())
    torch.testing.assert_close(there.jacobian[0, :, 0], torch.tensor([1.0, 5.0, 0.0]).double())
    assert there.groups.tolist() == [0, 1, 2]
    assert there.paired.tolist() == [False, True, False]
    ahead = Across(RESIDUALS, ACROSS.beyond, ACROSS.far - 0.7)
    torch.testing.assert_close(
        jumps().local(measured(2.0, jumps().values(ahead))).residuals[1, 2], torch.tensor(0.0).double()
    )


def test_what_is_measured_holds_the_residuals_as_they_are() -> None:
    own = jumps().own(measured(2.0))
    assert torch.equal(own.residuals, RESIDUALS)
    assert own.jacobian[1, :, 0].tolist() == [1.0, 5.0]
    assert own.paired.tolist() == [False, True]


@pytest.mark.parametrize(("move", "led"), [(0.15, True), (0.09, False), (-0.15, False)])
def test_those_are_led_that_a_move_brings_half_of_the_way(move: float, led: bool) -> None:
    found = jumps().crossed(measured(2.0), torch.full((3, 1), move).double())
    assert bool(found.led[1]) == led
    assert found.worth == (pytest.approx(1 / 3) if led else 0.0)


def test_nearer_to_a_jump_the_way_that_is_left_is_dearer_and_beyond_it_stays_as_it_is() -> None:
    for far, gain, left in ((0.1, 0.8, 0.1), (-0.1, 1.0, 0.4), (0.6, 1.0, 0.4)):
        there = Across(ACROSS.residuals.clone(), ACROSS.beyond, ACROSS.far.clone())
        there.residuals[1, 1], there.far[1, 1] = -1.3, far
        found = jumps().nearer(measured(2.0, jumps().values(there)))
        assert (float(found.gain[1]), float(found.far[1])) == pytest.approx((gain, left))
