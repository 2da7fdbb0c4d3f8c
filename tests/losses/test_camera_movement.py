"""Camera movement (Eq. 11-12): layer-wise flow, fields instead of pixels in robust mode."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import pytest
import torch
from torch import Tensor

from cltransfer.features import Features
from cltransfer.losses._affine_flow import affine_flow_residuals, fit_affine_flow
from cltransfer.losses.camera_movement import CameraMovement, layer_endpoint_errors, weight_note
from cltransfer.losses.shot_size import ShotSize
from cltransfer.testing import sample_features

NAN = float("nan")


def moving(field: list[list[float]], size: tuple[int, int] = (64, 36)) -> Features:
    """One frame whose three layers, bands one above the other, move by ``field`` (2, 3) over 1, u, v [frame widths]."""
    width, height = size
    v, u = torch.meshgrid(
        (torch.arange(height) + 0.5) / height - 0.5, (torch.arange(width) + 0.5) / width - 0.5, indexing="ij"
    )
    basis = torch.stack([torch.ones_like(u), u, v])
    flow = torch.einsum("cd,dhw->chw", torch.tensor(field), basis)[None] * width
    band = (torch.arange(height) * 3 // height)[:, None].expand(height, width)
    layers = torch.stack([band == k for k in range(3)])[None]
    return replace(sample_features(0, 1), size=size, flow=flow, layers=layers)


@pytest.mark.parametrize(
    ("loss", "width", "told"),
    [
        (CameraMovement(), 640, ""),
        (CameraMovement(mode="faithful", weight=0.0625), 640, ""),
        (CameraMovement(mode="faithful", weight=0.0625), 160, ""),  # the preset's, of other clips
        (CameraMovement(mode="faithful", weight=0.0625), 1920, ""),
        (CameraMovement(weight=1.0), 640, ""),  # a choice
        (CameraMovement(weight=0.0), 640, ""),
        (ShotSize(weight=4000.0), 640, ""),
        (
            CameraMovement(mode="faithful"),
            640,
            "640 times what its tolerance asks for, mode faithful being in pixels of frames 640 wide: "
            "set losses.camera_movement.weight=0.0625",
        ),
        (
            CameraMovement(weight=0.0625),
            160,
            "1/640 of what its tolerance asks for, mode robust being in frame widths: "
            "set losses.camera_movement.weight=40",
        ),
    ],
)
def test_a_weight_that_is_meant_for_the_other_mode_is_told_with_the_right_one(
    loss: CameraMovement | ShotSize, width: int, told: str
) -> None:
    assert weight_note({"camera_movement": loss}, width) == (told and f"camera_movement counts {told}")
    assert weight_note({}, width) == ""


STILL = [[0.0, 0, 0], [0.0, 0, 0]]
PAN = [[0.03, 0, 0], [0.0, 0, 0]]
PUSH = [[0.0, 0.04, 0], [0.0, 0, 0.04]]
ROLL = [[0.0, 0, 0.04], [0.0, -0.04, 0]]


def test_pan_costs_its_share_of_the_frame_width() -> None:
    assert float(CameraMovement()(moving(STILL), moving(PAN))) == pytest.approx(0.03, rel=1e-4)


@pytest.mark.parametrize("field", [PUSH, ROLL])
def test_push_and_roll_are_seen_though_their_mean_is_zero_row_11(field: list[list[float]]) -> None:
    assert moving(field).flow.mean().abs() < 1e-6
    assert float(CameraMovement()(moving(STILL), moving(field))) > 0.01


def test_closed_form_is_the_mean_squared_difference_of_the_fields_row_11() -> None:
    random = torch.Generator().manual_seed(0)
    first, second = (torch.randn(1, 2, 36, 64, generator=random) for _ in range(2))
    layers = sample_features(3, 1).layers
    a, b = fit_affine_flow(first, layers, (64, 36)), fit_affine_flow(second, layers, (64, 36))
    v, u = torch.meshgrid((torch.arange(36) + 0.5) / 36 - 0.5, (torch.arange(64) + 0.5) / 64 - 0.5, indexing="ij")
    basis = torch.stack([torch.ones_like(u), u, v]).double()
    difference = torch.einsum("kcd,dhw->kchw", (b.coefficients - a.coefficients)[0], basis)
    expected = [difference[k][:, layers[0, k]].square().sum(0).mean().sqrt() for k in range(3)]
    got = affine_flow_residuals(a, b).norm(dim=-1)[0]
    torch.testing.assert_close(got, torch.stack(expected), rtol=1e-4, atol=0)


def test_fit_is_least_squares() -> None:
    flow = torch.randn(1, 2, 36, 64, generator=torch.Generator().manual_seed(1))
    layers = sample_features(3, 1).layers
    v, u = torch.meshgrid((torch.arange(36) + 0.5) / 36 - 0.5, (torch.arange(64) + 0.5) / 64 - 0.5, indexing="ij")
    basis = torch.stack([torch.ones_like(u), u, v], dim=-1)
    fitted = fit_affine_flow(flow, layers, (1, 1)).coefficients[0]
    for k in range(3):
        inside = layers[0, k]
        expected = torch.linalg.lstsq(basis[inside].double(), flow[0, :, inside].T.double()).solution.T
        torch.testing.assert_close(fitted[k], expected, rtol=1e-3, atol=1e-4)


def test_different_sizes_compare_in_frame_widths_row_11() -> None:
    assert float(CameraMovement()(moving(PUSH), moving(PUSH, (128, 72)))) == pytest.approx(0, abs=1e-6)
    assert float(CameraMovement()(moving(PAN), moving(STILL, (128, 72)))) == pytest.approx(0.03, rel=1e-4)


@pytest.mark.parametrize("size", [(30, 48), (48, 48), (80, 20)])
def test_a_push_is_the_same_in_frames_of_another_shape(size: tuple[int, int]) -> None:
    """A flow of 2 % of the way from the frame's middle, of each pixel; the field is over u, v across the frame."""
    wide, other = (
        moving([[0, 0.02, 0], [0, 0, 0.02 * height / width]], (width, height)) for width, height in ((64, 36), size)
    )
    assert float(CameraMovement()(wide, other)) < 1e-6
    assert float(CameraMovement()(other, wide)) < 1e-6
    pushed = moving([[0, 0.03, 0], [0, 0, 0.03 * size[1] / size[0]]], size)
    assert float(CameraMovement()(wide, pushed)) > 1e-3


@pytest.mark.parametrize("grid", [(24, 24), (64, 28), (20, 40)])
def test_a_push_is_the_same_on_a_grid_of_another_shape(grid: tuple[int, int]) -> None:
    """As networks have one that read every frame as a square."""
    push = [[0, 0.02, 0], [0, 0, 0.02 * 36 / 64]]
    whole = moving(push, (64, 36))
    coarse = moving(push, grid)  # vectors in its own width
    coarse = replace(coarse, size=(64, 36), flow=coarse.require("flow") * 64 / grid[0])
    assert float(CameraMovement()(whole, coarse)) < 1e-4
    assert float(CameraMovement()(coarse, whole)) < 1e-4


def test_faithful_rescales_vectors_when_sizes_differ_row_11() -> None:
    loss = CameraMovement(mode="faithful")
    assert float(loss(moving(PAN), moving(PAN, (128, 72)))) == pytest.approx(0, abs=1e-5)
    assert float(loss(moving(PAN), moving(STILL, (128, 72)))) == pytest.approx(0.03 * 64, rel=1e-5)
    assert float(loss(moving(PAN, (128, 72)), moving(STILL))) == pytest.approx(0.03 * 128, rel=1e-5)


def test_faithful_needs_layers_that_overlap_row_11() -> None:
    reference, rendered = moving(STILL), moving(PAN)
    swapped = replace(rendered, layers=rendered.layers[:, [1, 2, 0]])
    assert CameraMovement(mode="faithful")(reference, swapped).isnan().all()
    assert float(CameraMovement()(reference, swapped)) == pytest.approx(0.03, rel=1e-4)


def test_faithful_takes_the_mean_over_the_layers_that_both_sides_have_row_7() -> None:
    """Eq. 11 would count a missing one as 0; one that is lost is left out, and robust charges it (the mismatch)."""
    reference, rendered = moving(STILL), moving(PAN)
    reference.layers[:, 0] = False
    loss = CameraMovement(mode="faithful")
    assert float(loss(reference, rendered)) == pytest.approx(0.03 * 64, rel=1e-5)  # not two thirds of it
    rendered.flow[rendered.layers[:, 1:2].expand_as(rendered.flow)] = 0.0
    assert float(loss(reference, rendered)) == pytest.approx(0.03 * 64 / 2, rel=1e-5)
    rendered.layers[:, 2] = False
    assert float(loss(reference, rendered)) == pytest.approx(0, abs=1e-5)


@pytest.mark.parametrize("mode", ["robust", "faithful"])
def test_first_frame_is_undefined_row_13(mode: str) -> None:
    first = moving(STILL)
    first = replace(first, flow=torch.full_like(first.flow, NAN))
    assert CameraMovement(mode=mode)(first, moving(PAN)).isnan().all()
    assert CameraMovement(mode=mode)(moving(PAN), first).isnan().all()


def test_layer_missing_in_the_render_costs_the_mismatch_row_7() -> None:
    reference, rendered = moving(PAN), moving(PAN)
    rendered.layers[:, 0] = False
    assert float(CameraMovement()(reference, rendered)) == pytest.approx(0.02 / 3)
    assert float(CameraMovement(mismatch=0.3)(reference, rendered)) == pytest.approx(0.1)


def test_to_lose_all_layers_that_the_reference_has_is_undefined_whatever_else_is_shown() -> None:
    reference, rendered = moving(PAN), moving(PAN)
    reference.layers[:, 0] = False
    rendered.layers[:, 1:] = False  # it fills the frame with what the reference does not have
    assert CameraMovement()(reference, rendered).isnan().all()


def test_a_layer_seen_through_a_keyhole_counts_as_missing() -> None:
    reference, rendered = moving(PAN), moving(PUSH)
    rendered.flow[:, :, :12, 6:] = NAN  # a tenth of the first layer is left, too little to tell its field
    lacking = float(CameraMovement(min_share=0.2)(reference, rendered))
    rendered.layers[:, 0] = False
    assert float(CameraMovement(min_share=0.0)(reference, rendered)) == pytest.approx(lacking)


def test_mean_is_over_the_layers_the_reference_has_row_7() -> None:
    reference, rendered = moving(STILL), moving(PAN)
    reference.layers[:, 0] = False
    assert float(CameraMovement()(reference, rendered)) == pytest.approx(0.03, rel=1e-4)
    reference.layers[:] = False
    assert CameraMovement()(reference, rendered).isnan().all()


@pytest.mark.parametrize("mode", ["robust", "faithful"])
def test_pixels_without_a_flow_are_left_out(mode: str) -> None:
    reference, rendered = moving(STILL), moving(PAN)
    whole = float(CameraMovement(mode=mode)(reference, rendered))
    rendered.flow[:, :, ::2, 1::3] = NAN
    assert float(CameraMovement(mode=mode)(reference, rendered)) == pytest.approx(whole, rel=1e-4)


def test_flow_without_confidence_does_not_count_in_robust_mode() -> None:
    reference, rendered = moving(PAN), moving(PAN)
    wrong = torch.zeros(1, 36, 64, dtype=torch.bool)
    wrong[:, :, 40:] = True
    rendered.flow[:, 0][wrong] = 20.0
    assert float(CameraMovement()(reference, rendered)) > 0.02
    gated = replace(rendered, flow_confidence=(~wrong).float())
    assert float(CameraMovement()(reference, gated)) == pytest.approx(0, abs=1e-5)
    faithful = CameraMovement(mode="faithful")
    assert float(faithful(reference, gated)) == float(faithful(reference, rendered))


def test_confidence_weighs_like_repeated_pixels() -> None:
    random = torch.Generator().manual_seed(3)
    flow, times = torch.randn(1, 2, 6, 8, generator=random), torch.randint(0, 4, (1, 6, 8), generator=random)
    v, u = torch.meshgrid((torch.arange(6) + 0.5) / 6 - 0.5, (torch.arange(8) + 0.5) / 8 - 0.5, indexing="ij")
    basis = torch.stack([torch.ones_like(u), u, v], dim=-1).flatten(0, 1).double()
    repeated, values = (x.repeat_interleave(times.flatten(), 0) for x in (basis, flow[0].flatten(1).T.double()))
    fit = fit_affine_flow(flow, torch.ones(1, 1, 6, 8, dtype=torch.bool), (1, 1), times / 3)
    expected = torch.linalg.lstsq(repeated, values).solution.T
    torch.testing.assert_close(fit.coefficients[0, 0], expected, rtol=1e-4, atol=1e-5)
    assert float(fit.area) == pytest.approx(float(times.float().mean() / 3))


def test_a_layer_of_little_confidence_has_the_field_and_moments_of_one_of_much() -> None:
    flow = torch.randn(1, 2, 6, 8, generator=torch.Generator().manual_seed(3))
    layers, trusted = torch.ones(1, 1, 6, 8, dtype=torch.bool), torch.ones(1, 6, 8)
    much, little = (fit_affine_flow(flow, layers, (1, 1), share * trusted) for share in (1.0, 2.0**-20))
    torch.testing.assert_close(little.moments, much.moments)
    torch.testing.assert_close(little.coefficients, much.coefficients)
    assert float(little.area) == 2.0**-20


def test_a_layer_that_no_confidence_is_left_in_has_no_field() -> None:
    frame = moving(PAN)
    fit = fit_affine_flow(frame.flow, frame.layers, (64, 36), torch.full((1, 36, 64), NAN))
    assert fit.coefficients.isnan().all()
    assert not fit.area.any()


def test_layers_weigh_the_same_whatever_their_area() -> None:
    reference, rendered = moving(STILL), moving(STILL)
    rendered.layers[:] = False
    rendered.layers[:, 0, :4], rendered.layers[:, 1, 4:8], rendered.layers[:, 2, 8:] = True, True, True
    rendered.flow[:, 0, :4] = 0.03 * 64
    assert float(CameraMovement()(reference, rendered)) == pytest.approx(0.01, rel=1e-4)


def test_line_of_pixels_has_a_finite_fit() -> None:
    frame = moving(PAN)
    layers = torch.zeros_like(frame.layers)
    layers[:, :, 5, :] = True
    fit = fit_affine_flow(frame.flow, layers, (64, 36))
    assert fit.coefficients.isfinite().all()
    torch.testing.assert_close(fit.coefficients[0, 0, 0, 0].float(), torch.tensor(0.03), rtol=1e-2, atol=0)


def test_faithful_is_in_pixels_and_priced_so() -> None:
    assert (CameraMovement().unit, CameraMovement(mode="faithful").unit) == ("frame widths", "px")
    assert CameraMovement(mode="faithful").penalty > CameraMovement().penalty * 1000


def test_flow_and_layers_on_two_grids_are_refused() -> None:
    with pytest.raises(ValueError, match="flow and layers must share a grid"):
        fit_affine_flow(torch.zeros(1, 2, 8, 8), torch.ones(1, 3, 4, 8, dtype=torch.bool), (8, 8))
    with pytest.raises(ValueError, match="flow and confidence must share a grid"):
        fit_affine_flow(torch.zeros(1, 2, 8, 8), torch.ones(1, 3, 8, 8, dtype=torch.bool), (8, 8), torch.ones(1, 4, 8))


def test_options_out_of_range_are_refused() -> None:
    with pytest.raises(ValueError, match="mismatch must be >= 0, got -1"):
        CameraMovement(mismatch=-1)
    with pytest.raises(ValueError, match=r"min_area must be in \(0, 1\], got 0"):
        CameraMovement(min_area=0)
    with pytest.raises(ValueError, match=r"min_share must be in \[0, 1\], got 2"):
        CameraMovement(min_share=2)


def test_fit_takes_less_than_a_millisecond_a_frame(within: Callable[[float, float], bool]) -> None:
    flow = torch.randn(10, 2, 90, 160, generator=torch.Generator().manual_seed(0))
    layers = torch.stack([flow[:, 0] < -0.5, flow[:, 0].abs() <= 0.5, flow[:, 0] > 0.5], dim=1)
    fit_affine_flow(flow, layers, (160, 90))
    seconds = []
    for _ in range(5):
        start = time.thread_time()
        fit_affine_flow(flow, layers, (160, 90))
        seconds.append(time.thread_time() - start)
    assert within(min(seconds) / 10, 1e-3)


@pytest.mark.parametrize("mode", ["robust", "faithful"])
def test_the_frame_as_one_layer_does_not_know_which_part_moves(mode: str) -> None:
    """A person of a tenth of the frame pans: a third of the layered loss, hardly anything of the global one."""
    still = moving(STILL)
    layers = torch.zeros_like(still.layers)
    layers[:, 1, :, :6] = True
    layers[:, 2, :, 6:] = True
    still = replace(still, layers=layers)
    flow = still.flow.clone()
    flow[:, 0, :, :6] = 6.4  # a tenth of the width
    moved = replace(still, flow=flow)
    layered, whole = (CameraMovement(mode=mode, layered=layered)(still, moved) for layered in (True, False))
    assert float(whole) < 0.8 * float(layered)


def test_the_frame_as_one_layer_asks_for_no_layers() -> None:
    features = replace(moving(STILL), layers=None)
    assert CameraMovement(layered=False).requires == ("flow",)
    assert float(CameraMovement(layered=False)(features, replace(moving(PAN), layers=None))) == pytest.approx(0.03)


def test_a_layer_differs_by_a_whip_pan_at_most() -> None:
    """A field fitted to a sliver can be anything beyond it; a view that lacks the layer must not be better."""
    wild = moving([[3.0, 50.0, 0], [0.0, 0, 80.0]])
    assert float(CameraMovement()(moving(STILL), wild)) == pytest.approx(CameraMovement.penalty, rel=1e-6)
    assert float(CameraMovement()(moving(STILL), moving([[0.2, 0, 0], [0.0, 0, 0]]))) == pytest.approx(0.2, rel=1e-4)


def test_half_precision_holds_a_flow_of_any_length() -> None:
    flow, layers = torch.full((1, 2, 4, 6), 300.0), torch.ones(1, 3, 4, 6, dtype=torch.bool)
    errors = layer_endpoint_errors(torch.zeros_like(flow).half(), flow.half(), layers)
    torch.testing.assert_close(errors, torch.full((1, 3), 300 * 2**0.5), rtol=1e-3, atol=0.0)


@pytest.mark.parametrize("kind", [torch.float32, torch.uint8])
def test_layers_that_are_not_bool_are_refused_as_features_refuse_them(kind: torch.dtype) -> None:
    flow, layers = torch.zeros(1, 2, 4, 6), torch.ones(1, 3, 4, 6, dtype=kind)
    with pytest.raises(TypeError) as told:
        layer_endpoint_errors(flow, flow, layers)
    with pytest.raises(TypeError) as usual:
        Features((6, 4), layers=layers)
    assert str(told.value) == str(usual.value)


@dataclass(frozen=True)
class Lower(CameraMovement):
    """Of the layers only what lies below a part of the frame."""

    below: float = 0.5

    def _layers(self, features: Features) -> Tensor:
        rows = torch.arange(features.size[1]) >= self.below * features.size[1]
        return super()._layers(features) & rows[:, None]


def test_a_class_of_it_that_takes_other_pixels_shares_no_fit() -> None:
    still, pan = (moving([[0.01 * k, 0, 0], [0, 0, 0]]) for k in (0, 1))
    above = torch.arange(36)[:, None] < 18
    moved = replace(pan, flow=torch.where(above, pan.require("flow"), still.require("flow")))  # the upper half alone
    lower, whole, usual = (float(loss(still, moved)) for loss in (Lower(), Lower(below=0.0), CameraMovement()))
    assert lower == pytest.approx(0.0, abs=1e-6)
    assert whole == pytest.approx(usual)
    assert usual > 0.003
