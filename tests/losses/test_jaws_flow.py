"""JAWS' loss of flow against loops, and what its switches change."""

from dataclasses import replace
from types import ModuleType

import pytest
import torch

from cltransfer.features import Features
from cltransfer.losses.jaws_flow import JawsFlow, flow_angle, flow_error
from cltransfer.testing import LossCase, sample_features


class TestQuirkyFlow(LossCase):
    component = JawsFlow(quirks=True, angular=0.0)


@pytest.mark.parametrize("quirks", [False, True])
def test_flow_is_the_published_formula(literal: ModuleType, quirks: bool) -> None:
    reference, rendered = sample_features(1, 1), sample_features(2, 1)
    rendered = replace(rendered, size=(128, 72))
    lists = [f.flow[0].flatten(1).T.tolist() for f in (reference, rendered)]
    expected = literal.flow(lists[0], reference.size, lists[1], rendered.size, quirks, 0.5)
    got = JawsFlow(quirks=quirks, angular=0.5)(reference, rendered)
    torch.testing.assert_close(got.double(), torch.tensor([expected], dtype=torch.float64), rtol=1e-4, atol=1e-6)


def test_squashed_units_weigh_sideways_motion_by_the_frames_shape() -> None:
    still = sample_features(1, 1)
    still = replace(still, flow=torch.zeros_like(still.flow))
    aside = replace(still, flow=torch.tensor([1.0, 0.0])[None, :, None, None].expand_as(still.flow).clone())
    plain, squashed = (float(JawsFlow(quirks=q, angular=0.0)(still, aside)) for q in (False, True))
    assert squashed / plain == pytest.approx((36 / 64) ** 2)


@pytest.mark.parametrize("size", [(240, 100), (160, 90), (90, 160)])
def test_a_whip_pan_costs_no_more_than_to_show_nothing(size: tuple[int, int]) -> None:
    width, height = size
    whipped = torch.zeros(1, 2, height, width)
    whipped[:, 0] = width / 4
    still, moved = (Features(size, flow=flow) for flow in (torch.zeros_like(whipped), whipped))
    assert float(JawsFlow(angular=0.0)(still, moved)) <= JawsFlow.penalty * (1 + 1e-6)


def test_pixels_without_a_flow_are_left_out() -> None:
    a, b = torch.zeros(1, 2, 4, 4), torch.ones(1, 2, 4, 4)
    b[..., 0] = torch.nan
    assert float(flow_error(a, b)) == 1
    assert float(flow_angle(a, b)) == pytest.approx(torch.atan2(torch.tensor(2.0).sqrt(), torch.tensor(1.0)) / torch.pi)
    assert flow_error(a, torch.full_like(b, torch.nan)).isnan().all()


@pytest.mark.parametrize("dtypes", [(torch.float64, torch.float32), (torch.float32, torch.float16)])
def test_flows_of_two_types_are_compared(dtypes: tuple[torch.dtype, torch.dtype]) -> None:
    features = (sample_features(3, 2), sample_features(1, 2))
    sides = [replace(f, flow=f.require("flow").to(dtype)) for f, dtype in zip(features, dtypes)]
    same = [replace(side, flow=side.require("flow").double()) for side in sides]
    torch.testing.assert_close(JawsFlow()(*sides).double(), JawsFlow()(*same), rtol=1e-3, atol=0.0, equal_nan=True)


def test_a_first_frame_is_undefined() -> None:
    first = sample_features(1, 2)
    first = replace(first, flow=torch.full_like(first.flow, torch.nan))
    assert JawsFlow()(first, sample_features(2, 2)).isnan().all()


def test_negative_angular_weight_is_refused() -> None:
    with pytest.raises(ValueError, match="angular must be >= 0"):
        JawsFlow(angular=-1)
