"""What must not change a loss: resolution, mirroring, order of frames, scale of depth."""

from dataclasses import replace

import pytest
import torch

from cltransfer.features import Features
from cltransfer.registry import LOSSES
from cltransfer.testing import sample_features, without_person

NAMES = ("shot_size", "framing", "filmic_space", "camera_movement", "camera_angle")


def enlarge(features: Features, times: int) -> Features:
    """The same frames on a grid ``times`` finer."""
    maps = {
        n: features.require(n).repeat_interleave(times, -1).repeat_interleave(times, -2)
        for n in ("depth", "subject", "layers", "flow")
    }
    maps["flow"] = maps["flow"] * times
    scale = torch.tensor([times, times, 1.0])
    size = (features.size[0] * times, features.size[1] * times)
    return replace(features, size=size, keypoints=features.keypoints * scale, **maps)


@pytest.mark.parametrize("name", ["filmic_space", "camera_movement", "faithful"])
@pytest.mark.parametrize("coarse", ["depth", "layers", "flow"])
def test_a_map_of_fewer_pixels_than_the_others_tells_the_same(name: str, coarse: str) -> None:
    faithful = {"mode": "faithful"} if name == "faithful" else {}
    loss = LOSSES.build("camera_movement" if faithful else name, faithful)
    small, other = sample_features(0, 3), sample_features(1, 3)
    fine = enlarge(small, 2)
    given = small.require(coarse)
    mixed = fine.having(coarse, given * 2 if coarse == "flow" else given)
    close(loss(mixed, mixed), torch.zeros(3))
    for rendered in (enlarge(other, 2), other):
        close(loss(mixed, rendered), loss(fine, rendered))
    close(loss(enlarge(other, 2), mixed), loss(enlarge(other, 2), fine))


def mirror(features: Features) -> Features:
    """The same frames seen in a mirror."""
    maps = {n: features.require(n).flip(-1) for n in ("depth", "subject", "layers", "flow")}
    maps["flow"] = maps["flow"] * torch.tensor([-1.0, 1.0])[:, None, None]
    keypoints = features.keypoints.clone()
    keypoints[..., 0] = features.size[0] - keypoints[..., 0]
    orientation = features.orientation * torch.tensor([-1.0, 1.0, -1.0])
    return replace(features, keypoints=keypoints, orientation=orientation, **maps)


def close(first: torch.Tensor, second: torch.Tensor) -> None:
    torch.testing.assert_close(first.double(), second.double(), rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_resolution_of_both_does_not_matter(name: str) -> None:
    reference, rendered = sample_features(1, 3), sample_features(2, 3)
    loss = LOSSES.build(name)
    atol = 2e-4 if name == "camera_movement" else 1e-6  # a step-wise enlarged flow is not quite affine
    torch.testing.assert_close(
        loss(enlarge(reference, 2), enlarge(rendered, 2)), loss(reference, rendered), atol=atol, rtol=1e-3
    )


@pytest.mark.parametrize("name", NAMES)
def test_resolution_of_one_side_does_not_matter(name: str) -> None:
    reference, rendered = sample_features(1, 3), sample_features(2, 3)
    loss = LOSSES.build(name)
    torch.testing.assert_close(loss(enlarge(reference, 2), rendered), loss(reference, rendered), atol=2e-4, rtol=1e-3)


@pytest.mark.parametrize("mode", ["robust", "faithful"])
@pytest.mark.parametrize("name", NAMES)
def test_mirroring_both_does_not_matter(name: str, mode: str) -> None:
    reference, rendered = sample_features(1, 3), sample_features(2, 3)
    loss = LOSSES.build(name, {"mode": mode})
    close(loss(mirror(reference), mirror(rendered)), loss(reference, rendered))


@pytest.mark.parametrize("name", ["framing", "camera_movement", "camera_angle"])
def test_mirroring_one_side_does_matter(name: str) -> None:
    features = sample_features(1, 3)
    assert (LOSSES.build(name)(features, mirror(features)) > 1e-3).all()


@pytest.mark.parametrize("name", NAMES)
def test_order_of_frames_does_not_matter(name: str) -> None:
    reference, rendered = sample_features(1, 4), sample_features(2, 4)
    order = [2, 0, 3, 1]
    loss = LOSSES.build(name)
    close(loss(reference[order], rendered[order]), loss(reference, rendered)[order])


def test_space_ignores_depth_scale_row_9() -> None:
    reference, rendered = sample_features(1, 3), sample_features(2, 3)
    loss = LOSSES.build("filmic_space")
    scaled = replace(rendered, depth=37 * rendered.depth)
    torch.testing.assert_close(loss(reference, scaled), loss(reference, rendered), atol=1e-3, rtol=0)


def test_space_is_the_same_for_depth_and_inverse_depth_row_9() -> None:
    reference, rendered = sample_features(1, 3), sample_features(2, 3)
    inverse = [replace(f, depth=1 / f.depth) for f in (reference, rendered)]
    loss = LOSSES.build("filmic_space")
    torch.testing.assert_close(loss(*inverse), loss(reference, rendered), atol=1e-3, rtol=1e-3)


def test_space_does_see_a_shift_of_inverse_depth_row_9() -> None:
    features = sample_features(1, 3)
    shifted = replace(features, depth=1 / (1 / features.depth + 0.1))
    assert (LOSSES.build("filmic_space")(features, shifted) > 0.1).all()


@pytest.mark.parametrize("mode", ["robust", "faithful"])
@pytest.mark.parametrize("name", ["shot_size", "framing", "filmic_space", "camera_angle"])
def test_person_missing_is_never_a_number_row_4(name: str, mode: str) -> None:
    reference, rendered = sample_features(1, 3), without_person(sample_features(2, 3))
    loss = LOSSES.build(name, {"mode": mode})
    assert loss(reference, rendered).isnan().all()
    assert loss.residuals(reference, rendered).isnan().any(1).all()
    assert loss(rendered, reference).isnan().all()


@pytest.mark.parametrize("name", NAMES)
def test_one_undefined_frame_leaves_the_others_row_7(name: str) -> None:
    reference, rendered = sample_features(1, 3), sample_features(2, 3)
    gone = replace(without_person(rendered), flow=torch.full_like(rendered.flow, float("nan")))
    mixed = Features.concatenate([rendered[0], gone[1], rendered[2]])
    value = LOSSES.build(name)(reference, mixed)
    assert value.isnan().tolist() == [False, True, False]
    close(value[[0, 2]], LOSSES.build(name)(reference, rendered)[[0, 2]])


@pytest.mark.parametrize("name", NAMES)
def test_total_is_one_when_every_loss_is_at_its_tolerance_row_12(name: str) -> None:
    tolerance = {
        "shot_size": 0.02,
        "framing": 0.02,
        "filmic_space": 0.05,
        "camera_movement": 0.005,
        "camera_angle": 0.05,
    }
    assert LOSSES.build(name).weight * tolerance[name] == pytest.approx(1 / 5)


@pytest.mark.parametrize("name", NAMES)
def test_raw_value_does_not_know_its_weight_row_12(name: str) -> None:
    reference, rendered = sample_features(1, 3), sample_features(2, 3)
    close(LOSSES.build(name, {"weight": 99.0})(reference, rendered), LOSSES.build(name)(reference, rendered))


@pytest.mark.parametrize("name", NAMES)
def test_same_input_gives_the_same_bits_row_25(name: str) -> None:
    loss = LOSSES.build(name)
    first, second = (loss(sample_features(1, 3), sample_features(2, 3)) for _ in range(2))
    assert torch.equal(first, second)
