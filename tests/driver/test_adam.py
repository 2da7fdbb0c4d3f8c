"""The gradient baseline: its parts against what they are named after, its costs, its strokes."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import torch
from torch import Tensor

from cltransfer.config import load_config
from cltransfer.config.adam import AdamConfig
from cltransfer.driver.adam import CLIP, LEAST_WEIGHT, POSE_RATE, GradNorm, Moments, central_differences, descend
from cltransfer.driver.problem import Problem
from cltransfer.errors import UsageError
from cltransfer.scenes.builtin import builtin_scene
from cltransfer.shots import shot
from cltransfer.transfer import Inputs, Result, transfer

SMALL = ("search_side=48", "output_side=96", "frames=2", "threads=1")


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Result]:
    """A push in transferred to the courtyard, each way once, from a given view: no evaluation goes into finding one."""
    subject = builtin_scene("courtyard").subject
    assert subject is not None
    view = tmp_path_factory.mktemp("view") / "view.json"
    shot("push_in", subject, (96, 54), 1).save(view)

    @cache
    def solve(preset: str, *overrides: str) -> Result:
        config = load_config(overrides=[f"preset={preset}", *SMALL, *overrides])
        return transfer(Inputs("builtin:courtyard", "builtin:push_in", init=str(view)), config)

    return solve


def test_moments_step_as_torchs_adam_does() -> None:
    slope = CLIP * torch.tensor([0.5, -0.1, 0.02], dtype=torch.float64)
    x = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    theirs, ours, moments = torch.optim.Adam([x], lr=0.01), torch.zeros(3, dtype=torch.float64), Moments(3)
    for step in range(5):
        x.grad = slope * (1 - 0.4 * step)
        theirs.step()
        ours = ours + 0.01 * moments.direction(x.grad)
    torch.testing.assert_close(ours, x.detach())


def test_a_long_gradient_is_cut_to_its_direction() -> None:
    slope = torch.tensor([3.0, -4.0], dtype=torch.float64)
    cut, same = Moments(2), Moments(2)
    cut.direction(slope)
    same.direction(CLIP * slope / 5)
    torch.testing.assert_close(cut.mean, same.mean)


def test_differences_ask_one_batch_of_twice_the_numbers_and_one() -> None:
    asked = []

    def evaluate(x: Tensor) -> Tensor:
        asked.append(len(x))
        return torch.stack([x[:, 0] * x[:, 2], x[:, 1] ** 2], dim=1)

    x = torch.tensor([2.0, 3.0, 5.0], dtype=torch.float64)
    values, slopes = central_differences(evaluate, x, (0, 1), 1e-3)
    assert asked == [5]
    torch.testing.assert_close(values, torch.tensor([10.0, 9.0], dtype=torch.float64))
    torch.testing.assert_close(slopes, torch.tensor([[5.0, 0.0], [0.0, 6.0]], dtype=torch.float64))


def test_gradnorm_lowers_the_weight_of_the_steeper_term() -> None:
    balance = GradNorm(2)
    slopes = torch.tensor([[3.0, 0.0], [0.0, 1.0]], dtype=torch.float64)
    for _ in range(10):
        weights = balance.update(torch.ones(2, dtype=torch.float64), slopes)
    assert weights[0] < 1 < weights[1]
    assert float(weights.sum()) == pytest.approx(2)


def test_gradnorm_raises_the_weight_of_the_term_that_lags() -> None:
    balance, slopes = GradNorm(2), torch.eye(2, dtype=torch.float64)
    balance.update(torch.tensor([1.0, 1.0], dtype=torch.float64), slopes)
    weights = balance.update(torch.tensor([0.1, 1.0], dtype=torch.float64), slopes)
    assert weights[0] < weights[1]


def test_gradnorm_never_silences_a_term() -> None:
    balance = GradNorm(2)
    slopes = torch.tensor([[1e6, 0.0], [0.0, 1.0]], dtype=torch.float64)
    for _ in range(200):
        weights = balance.update(torch.ones(2, dtype=torch.float64), slopes)
    assert float(weights.min()) >= LEAST_WEIGHT * 2 / (2 + 2 * LEAST_WEIGHT)


@pytest.mark.parametrize("quirks", [False, True])
def test_gradnorm_stands_still_where_a_term_starts_at_nothing(quirks: bool) -> None:
    balance = GradNorm(2, quirks)
    values, slopes = torch.tensor([1.0, 0.0], dtype=torch.float64), torch.eye(2, dtype=torch.float64)
    assert torch.equal(balance.update(values, 5 * slopes), torch.ones(2, dtype=torch.float64))


@pytest.mark.parametrize(("quirks", "least"), [(False, 1.0), (True, LEAST_WEIGHT)])
def test_gradnorm_is_not_silenced_by_a_term_that_leaves_nothing(quirks: bool, least: float) -> None:
    """But in the published code it is, by an infinite ratio."""
    balance, slopes = GradNorm(2, quirks), torch.eye(2, dtype=torch.float64)
    balance.update(torch.tensor([1.0, 0.0], dtype=torch.float64), slopes)
    for _ in range(60):
        weights = balance.update(torch.tensor([1.0, 0.3], dtype=torch.float64), slopes)
    torch.testing.assert_close(weights, torch.tensor([least, 2 - least], dtype=torch.float64), rtol=0, atol=2e-3)


def test_gradnorm_balances_the_others_without_a_term_that_starts_at_nothing() -> None:
    two, three = GradNorm(2), GradNorm(3)
    slopes = torch.tensor([[3.0, 0.0], [0.0, 1.0], [0.0, 0.0]], dtype=torch.float64)
    for step in range(10):
        values = torch.tensor([1.0, 0.9**step, 0.0], dtype=torch.float64)
        apart, together = two.update(values[:2], slopes[:2]), three.update(values, slopes)
        assert torch.equal(together, torch.cat([apart, torch.ones(1, dtype=torch.float64)]))
    assert apart[0] < 1 < apart[1]


def test_gradnorm_has_nothing_to_balance_where_all_terms_start_at_nothing() -> None:
    balance, slopes = GradNorm(2), torch.eye(2, dtype=torch.float64)
    for values in ([0.0, 0.0], [1.0, 0.5]):
        weights = balance.update(torch.tensor(values, dtype=torch.float64), slopes)
        assert torch.equal(weights, torch.ones(2, dtype=torch.float64))


def test_the_published_code_weighs_a_frames_lens_stroke_too_before_it_competes() -> None:
    """Weights (1.03, 0.97): 0.10 + 6.82 in the first stroke, 6.82 in the second, where 7 would have lost."""
    terms = {"pose": lambda x: torch.full_like(x[:, 0], 0.1), "flow": lambda x: 7 - 1e-4 * x[:, 0]}
    objective = SimpleNamespace(losses=terms, of_motion=torch.tensor([False, True]))
    problem = SimpleNamespace(
        stage=SimpleNamespace(objective=objective),
        search=SimpleNamespace(dimensions=2),
        dimensions=2,
        before="a frame",
        free_lens=True,
        defined=torch.ones(2, dtype=torch.bool),
        bounds=(-torch.ones(2).double(), torch.ones(2).double()),
        weighted=lambda x: torch.stack([term(x) for term in terms.values()], dim=1),
    )
    options = AdamConfig(iterations=1, rate=0.1, strokes="two", weighting="gradnorm", quirks=True)
    start = torch.zeros(2, dtype=torch.float64)
    found = descend(cast(Problem, problem), start, options, np.random.default_rng(0))
    assert float(found.x[0]) > 0.5 * POSE_RATE * options.rate  # the pose that the first stroke led to


@pytest.mark.parametrize(
    ("preset", "a_step", "steps"), [("jaws_clean", 15 + 3, 2), ("jaws_code", 15 + 3, 2), ("five_adam", 17, 1)]
)
def test_every_evaluation_is_counted(solved: Callable[..., Result], preset: str, a_step: int, steps: int) -> None:
    found = solved(preset, "adam.iterations=4")
    frames = found.kept.found.frames
    assert [frame.generations for frame in frames] == [2, 4 * steps]  # all at once, then in strokes
    assert found.spent.evaluations == 2 * 17 + 4 * a_step


@pytest.mark.parametrize("preset", ["jaws_clean", "jaws_code", "five_adam"])
def test_a_descent_never_ends_above_its_start(solved: Callable[..., Result], preset: str) -> None:
    found = solved(preset, "adam.iterations=4")
    for i, frame in enumerate(found.kept.found.frames):
        assert frame.total == pytest.approx(float(found.searched.totals[i]), rel=1e-4, abs=1e-6)
    later = found.searched.totals[1:].mean()
    assert float(later) < 0.985 * float(found.held.totals[1:].mean())  # uphill, the first frame alone gains 0.2 %


def test_two_runs_give_the_same_bits(solved: Callable[..., Result]) -> None:
    first, second = solved("jaws_clean", "adam.iterations=4"), solved("jaws_clean", "adam.iterations=4", "seed=0")
    assert first is not second  # the same in other words, so it was run again
    assert torch.equal(first.trajectory.camera.w2c, second.trajectory.camera.w2c)


def test_any_search_can_be_descended_in(solved: Callable[..., Result]) -> None:
    found = solved("five_adam", "search.subject_orbit={}", "adam.iterations=6", "adam.rate=0.02")
    assert float(found.searched.totals.mean()) < float(found.held.totals.mean())


def test_a_fixed_lens_leaves_one_stroke(solved: Callable[..., Result]) -> None:
    found = solved("jaws_clean", "zoom=fixed", "adam.iterations=3")
    assert [frame.generations for frame in found.kept.found.frames] == [1, 3]
    torch.testing.assert_close(found.trajectory.camera.focal[1:], found.trajectory.camera.focal[:1])


@pytest.mark.parametrize(
    ("override", "reason"), [("adam.iterations=0", "iterations"), ("adam.rate=-1", "rate"), ("adam.speed=1", "speed")]
)
def test_options_out_of_range_or_unknown_are_one_line(override: str, reason: str) -> None:
    with pytest.raises(UsageError, match=reason):
        load_config(overrides=[override])


@pytest.mark.parametrize("switch", ["adam.quirks=true", "adam.weighting=fixed", "adam.strokes=one", "adam.rate=0.05"])
def test_every_switch_changes_the_path(solved: Callable[..., Result], switch: str) -> None:
    plain, switched = (solved("jaws_clean", "adam.iterations=4", *more) for more in ((), (switch,)))
    assert not torch.equal(plain.trajectory.camera.w2c[1], switched.trajectory.camera.w2c[1])
