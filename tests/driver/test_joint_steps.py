"""Which steps of a path refined as a whole are taken, and what those tell that are not."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest
import torch
from torch import Tensor

from cltransfer.driver.joint import NARROWER, ONCE, WIDE, Effort, Moves, refine_path
from cltransfer.driver.spline import Local, bending
from cltransfer.pipeline.objective import Across

FRAMES = 8
SHAKES = torch.tensor([1.0, -1.0], dtype=torch.float64).repeat(FRAMES // 2)[:, None]


def stays(x: Tensor) -> Tensor:
    return torch.zeros_like(x)


@dataclass
class Springs:
    """A clip whose frames have one parameter and one residual, of which a slope is told that need not be its own."""

    own: Callable[[Tensor], Tensor]
    told: float
    beyond: Callable[[Tensor], Tensor] = stays
    far: Callable[[Tensor], Tensor] = stays  # 0: no jump is known of
    coming: float = -1.0  # slope that is told of that
    at: None = None  # evenly spaced
    measured: list[float] = field(default_factory=list)  # steps of the differences
    tried: list[float] = field(default_factory=list)  # where the first frame of each path stood

    def inside(self, x: Tensor, kept: Tensor | None = None) -> Tensor:
        return x

    def residuals(self, x: Tensor) -> Tensor:
        self.tried.append(float(x[0]))
        return self.own(x)

    def across(self, x: Tensor, seen: bool = False) -> Across:
        return Across(self.own(x), self.beyond(x), self.far(x))

    def mean_total(self, residuals: Tensor) -> float:
        return float(residuals.abs().sum(1).mean())

    def local(self, x: Tensor, residuals: Tensor, step: float, shared: int, first: int, jumps: Any = None) -> Local:
        self.measured.append(step)
        slopes = [self.told] if jumps is None else [self.told, 0.0, self.coming]
        jacobian = torch.tensor(slopes, dtype=torch.float64)[:, None].repeat(FRAMES, 1, 1)
        return Local(residuals, jacobian, torch.tensor([0]), torch.zeros(len(slopes), dtype=torch.bool))


def refined(clip: Any, x: Tensor, effort: Effort, about: Tensor | None = None, knots: int = FRAMES) -> Tensor:
    return refine_path(clip, x, clip.residuals(x), Moves(knots, None, fade=False, about=about), effort)[0]


def alike(x: float) -> Tensor:
    """A path that stands at x, (N, 1)."""
    return torch.full((FRAMES, 1), x, dtype=torch.float64)


@pytest.mark.parametrize("known", [True, False])
def test_a_path_comes_to_shake_as_the_reference_does_and_by_itself_does_not(known: bool) -> None:
    clip = Springs(lambda x: x - 0.1 * SHAKES, 1.0)
    x = refined(clip, alike(0.0), Effort(1, 8), 0.1 * SHAKES if known else None)
    assert float((x * SHAKES).mean()) == pytest.approx(0.1 if known else 0.0, abs=0.02)


def test_a_step_that_bends_more_than_it_saves_is_not_taken() -> None:
    clip, x = Springs(lambda x: 2 * x - SHAKES, 50.0), alike(0.0)
    there = refined(clip, x, Effort(1, 2))
    assert clip.mean_total(clip.residuals(there)) + bending(there) <= clip.mean_total(clip.residuals(x))
    assert bool((there != x).any())


def test_what_a_step_shows_that_is_not_taken_leads_the_next_one() -> None:
    clip = Springs(lambda x: x - 0.3, -1.0)  # told to fall where it rises
    refined(clip, alike(0.0), Effort(1, 2), knots=1)
    assert clip.tried[:3] == pytest.approx([0.0, -0.3, 0.3], abs=0.03)


def creeping(x: Tensor) -> Tensor:
    return 0.4 - 0.1 * x  # though it is told to come as x goes


def test_a_path_led_towards_a_jump_that_it_does_not_reach_stays_where_it_costs_less() -> None:
    clip = Springs(lambda x: 0.5 + 0.5 * x, 0.5, lambda x: 0 * x + 0.1, creeping)
    x = alike(0.0)
    assert torch.equal(refined(clip, x, Effort(1, 1), knots=1), x)


def test_whether_a_round_gained_is_told_by_the_losses_and_not_by_what_leads() -> None:
    clip = Springs(lambda x: 0.5 - 0.5 * x, -0.5, lambda x: 0.1 + x, lambda x: 0.4 - x)
    refined(clip, alike(0.0), Effort(2, 1), knots=1)
    assert clip.measured == pytest.approx([ONCE, NARROWER * WIDE])
