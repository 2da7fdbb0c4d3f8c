"""Camera angle (Eq. 13-14): with and without the short way round."""

import math
from dataclasses import replace
from typing import Literal

import pytest
import torch

from cltransfer.features import Features
from cltransfer.losses.camera_angle import CameraAngle, camera_angle_loss
from cltransfer.orientation import wrap
from cltransfer.testing import sample_features


def looking(yaw: float, pitch: float = 0.0, roll: float = 0.0) -> Features:
    return replace(sample_features(0, 1), orientation=torch.tensor([[yaw, pitch, roll]], dtype=torch.float64))


def test_is_the_sum_over_the_three_angles() -> None:
    assert float(CameraAngle()(looking(0.1, 0.2, -0.3), looking(0.2, 0.0, 0.1))) == pytest.approx(0.7)


def test_robust_takes_the_short_way_round_row_1() -> None:
    degree = math.radians(1)
    assert float(CameraAngle()(looking(359 * degree), looking(degree))) == pytest.approx(2 * degree)


def test_faithful_does_not_wrap_row_1() -> None:
    degree = math.radians(1)
    loss = CameraAngle(mode="faithful")
    assert float(loss(looking(359 * degree), looking(degree))) == pytest.approx(358 * degree)


def test_wrapped_angle_is_above_minus_pi_up_to_pi_row_1() -> None:
    angles = torch.linspace(-20, 20, 401, dtype=torch.float64)
    wrapped = wrap(angles)
    assert ((wrapped > -math.pi) & (wrapped <= math.pi)).all()
    torch.testing.assert_close(torch.exp(1j * wrapped), torch.exp(1j * angles))
    assert float(wrap(torch.tensor(math.pi, dtype=torch.float64))) == math.pi


@pytest.mark.parametrize("mode", ["robust", "faithful"])
def test_no_pair_of_angles_costs_more_than_the_penalty_row_4(mode: Literal["robust", "faithful"]) -> None:
    """Yaw and roll half a turn either way, pitch a quarter: what an orientation can be."""
    most = torch.tensor([math.pi, math.pi / 2, math.pi])
    angles = (2 * torch.rand(2, 500, 3, generator=torch.Generator().manual_seed(0)) - 1) * most
    angles = torch.cat([angles, torch.stack([most, -most])[:, None]], dim=1)
    costs = camera_angle_loss(angles[0], angles[1], wrapped=mode == "robust")
    assert costs.max() <= CameraAngle(mode=mode).penalty + 1e-5


def test_undefined_angle_is_undefined() -> None:
    assert CameraAngle()(looking(0.0), looking(float("nan"))).isnan().all()
