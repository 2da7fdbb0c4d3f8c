"""Splines through a path: what they can express they find, weighted by what the losses make of each frame."""

import math

import pytest
import torch
from torch import Tensor

from cltransfer.driver.spline import STIFFNESS, Local, basis, bending, fit, moved
from cltransfer.pipeline.objective import group_norms


def local(x: Tensor, wanted: Tensor, paired: bool = False) -> Local:
    """Residuals x - wanted, one group a dimension; with ``paired`` also the motion between frames."""
    N, D = x.shape
    residuals, jacobian, marks = x - wanted, torch.eye(D, dtype=torch.float64).repeat(N, 1, 1), [False] * D
    if paired:
        motion = torch.zeros_like(x)
        motion[1:] = (x[1:] - x[:-1]) - (wanted[1:] - wanted[:-1])
        residuals, jacobian = torch.cat([residuals, motion], 1), torch.cat([jacobian, jacobian], 1)
        jacobian[0, D:] = 0  # the first frame has none before it
        marks = [False] * D + [True] * D
    return Local(residuals, jacobian, torch.arange(len(marks)), torch.tensor(marks))


def ramp(frames: int) -> Tensor:
    t = torch.linspace(0, 1, frames, dtype=torch.float64)
    return torch.stack([t, -2 * t, torch.ones_like(t)], dim=1)


@pytest.mark.parametrize("knots", [1, 2, 3, 4, 6, 12])
def test_a_basis_sums_to_one_and_reaches_the_ends(knots: int) -> None:
    values = basis(torch.arange(12).double(), knots)
    assert values.sum(1) == pytest.approx(1.0)
    assert values[0, 0] == pytest.approx(1.0)
    assert values[-1, -1] == pytest.approx(1.0)


@pytest.mark.parametrize("knots", [2, 4, 6])
def test_a_line_is_found_from_a_shaken_one(knots: int) -> None:
    wanted = ramp(24)
    shaken = wanted + 0.05 * torch.randn(24, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    found = fit(shaken, local(shaken, wanted), knots)
    torch.testing.assert_close(found.x, wanted, atol=2e-3, rtol=0)
    assert found.predicted == pytest.approx(0.0, abs=5e-3)


def test_without_a_model_the_path_itself_is_fitted() -> None:
    found = fit(ramp(10), None, 2)
    torch.testing.assert_close(found.x, ramp(10))
    assert found.predicted is None


def test_a_frame_that_no_residual_determines_is_bridged_by_its_neighbours() -> None:
    wanted = ramp(12)
    x = wanted.clone()
    x[5] += 3.0  # lost: its residuals do not move
    model = local(wanted, wanted)
    model.jacobian[5] = 0.0
    found = fit(x, Local(model.residuals, model.jacobian, model.groups, model.paired), 4)
    assert float((found.x[5] - wanted[5]).abs().max()) < 0.05


def test_the_prediction_is_exact_where_residuals_are_linear_also_between_frames() -> None:
    generator = torch.Generator().manual_seed(3)
    wanted = torch.randn(16, 2, dtype=torch.float64, generator=generator).cumsum(0) * 0.2
    x = wanted + 0.1 * torch.randn(16, 2, dtype=torch.float64, generator=generator)
    found = fit(x, local(x, wanted, paired=True), 6)
    again = local(found.x, wanted, paired=True).residuals
    assert found.predicted == pytest.approx(float(again.abs().sum(1).mean()), rel=1e-9)


def test_a_fixed_direction_keeps_its_value_along_the_path() -> None:
    direction = torch.tensor([0.8, 0.8, 0.0], dtype=torch.float64)
    found = fit(ramp(24), local(ramp(24), ramp(24)), 6, direction)
    along = found.x @ direction
    assert float(along.max() - along.min()) < 1e-9
    assert float((found.x[:, 2] - 1).abs().max()) < 1e-3  # what is across it stays free
    assert not math.isclose(float(found.x[0, 0]), float(found.x[-1, 0]))


def test_a_move_goes_where_the_model_leads_and_less_far_the_more_it_is_damped() -> None:
    wanted = ramp(12)
    bent = wanted + 0.2
    free, damped = (moved(bent, local(bent, wanted), 4, damping) for damping in (1e-6, 10.0))
    torch.testing.assert_close(free.x, wanted, atol=1e-3, rtol=0)
    assert free.predicted == pytest.approx(0.0, abs=1e-3)
    assert 0 < float((damped.x - bent).norm()) < 0.3 * float((free.x - bent).norm())


def test_no_term_that_is_met_is_given_up_for_one_that_gains_less() -> None:
    """What is least of |x| + |0.5 - 0.6 x| is met at 0, however small |x| is beside the other one."""
    x = torch.full((12, 1), 0.1, dtype=torch.float64)
    slopes = torch.tensor([[1.0], [-0.6]], dtype=torch.float64)
    groups, paired = torch.arange(2), torch.zeros(2, dtype=torch.bool)
    offset = torch.tensor([0.0, 0.5], dtype=torch.float64)
    terms = Local(x * slopes[:, 0] + offset, slopes.expand(12, 2, 1), groups, paired)
    for found in (fit(x, terms, 4), moved(x, terms, 4, 1e-6)):
        assert float(found.x.abs().max()) < 0.015
        assert found.predicted == pytest.approx(0.5, abs=0.006)


def test_a_move_is_as_smooth_as_its_knots_and_never_longer_than_allowed() -> None:
    wanted = ramp(12)
    shaken = wanted + 3 * torch.randn(12, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(2))
    move = moved(shaken, local(shaken, wanted), 2, 1e-6).x - shaken
    assert float(move.diff(n=2, dim=0).abs().max()) < 1e-9
    assert float((moved(wanted + 9, local(wanted + 9, wanted), 2, 1e-6).x - wanted - 9).abs().max()) <= 0.5 + 1e-12


def test_what_a_move_that_was_shortened_promises_is_what_the_model_says_of_it() -> None:
    wanted = ramp(12)
    far = local(wanted + 9, wanted)
    move = moved(wanted + 9, far, 2, 1e-6)
    there = far.residuals + torch.from_numpy(far.slope @ (move.x - wanted - 9).numpy().ravel()).reshape(12, -1)
    assert move.predicted == pytest.approx(float(group_norms(there, far.groups).sum(1).mean()))


def test_a_move_bends_less_than_its_frames_ask_for_but_as_the_reference_does() -> None:
    waves = ramp(24) + 0.05 * torch.sin(torch.linspace(0, 20, 24, dtype=torch.float64))[:, None]
    asked = local(ramp(24), waves)
    plain, about = moved(ramp(24), asked, 12, 1e-6).x, moved(ramp(24), asked, 12, 1e-6, about=waves).x
    assert bending(plain) < 0.5 * bending(waves)
    assert float((about - waves).abs().max()) < 0.4 * float((plain - waves).abs().max())


def test_bends_cost_their_mean_square_and_a_steady_path_nothing() -> None:
    cubic = torch.linspace(0, 7, 8, dtype=torch.float64)[:, None] ** 3  # third difference 6
    assert bending(cubic) == pytest.approx(STIFFNESS / 2 * 36 * 5 / 8)
    assert bending(ramp(24)) == pytest.approx(0.0, abs=1e-20)
    assert bending(cubic[:3]) == 0.0


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_a_path_too_short_to_bend_is_moved_too(frames: int) -> None:
    found = moved(ramp(frames) + 0.1, local(ramp(frames) + 0.1, ramp(frames)), frames, 1e-6)
    torch.testing.assert_close(found.x, ramp(frames), atol=1e-3, rtol=0)


THINNED = torch.tensor([0.0, 1, 3, 4, 6, 7, 9, 10, 12, 13, 15, 16], dtype=torch.float64)


def test_a_steady_move_is_one_however_its_frames_are_spaced() -> None:
    line = THINNED[:, None] * torch.tensor([0.1, -0.2], dtype=torch.float64)
    assert bending(line, at=THINNED) == pytest.approx(0.0, abs=1e-20)
    assert bending(line) > 1.0
    assert fit(line, None, 2, at=THINNED).x == pytest.approx(line)
    assert float((fit(line, None, 2).x - line).abs().max()) > 0.03
    asked = local(line + 0.1, line)
    assert moved(line + 0.1, asked, 6, 1e-6, at=THINNED).x == pytest.approx(line, abs=1e-3)


def test_bends_of_even_frames_are_the_same_by_their_places() -> None:
    x = torch.rand(9, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    at = torch.arange(9, dtype=torch.float64)
    assert bending(x, at=at) == pytest.approx(bending(x))
    assert bending(THINNED[:, None] ** 3, at=THINNED) == pytest.approx(STIFFNESS / 2 * 36 * 9 / 12)
    assert bending(x[:3], at=at[:3]) == 0.0


def test_a_group_is_weighed_by_its_norm_and_not_each_residual_by_itself() -> None:
    """The point of least distance to three others, in every frame; by each residual it would be their medians."""
    points = torch.tensor([[0.0, 0.0], [4.0, 0.0], [1.0, 3.0]], dtype=torch.float64)
    x = torch.tensor([2.0, 1.5], dtype=torch.float64).expand(12, 2).clone()
    slopes = torch.eye(2, dtype=torch.float64).repeat(3, 1).expand(12, 6, 2)
    groups, paired = torch.tensor([0, 0, 1, 1, 2, 2]), torch.zeros(6, dtype=torch.bool)
    best = torch.tensor([1.302169, 1.046746], dtype=torch.float64)  # by scipy's Nelder-Mead
    for solve in (lambda x, terms: fit(x, terms, 1).x, lambda x, terms: moved(x, terms, 1, 1e-6).x):
        there = x
        for _ in range(30):
            there = solve(there, Local((there[:, None] - points).flatten(1), slopes, groups, paired))
        torch.testing.assert_close(there, best.expand(12, 2), atol=0.03, rtol=0)
