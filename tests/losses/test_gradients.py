"""What docs/python.md says of a loss as a function: one value a frame, and which features its gradients reach."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from cltransfer import LOSSES
from cltransfer.features import NAMES, Features
from cltransfer.losses.filmic_space import filmic_space_loss
from cltransfer.testing import sample_features

REACHED = {
    ("shot_size", "robust"): {"keypoints"},
    ("shot_size", "faithful"): {"keypoints"},
    ("framing", "robust"): {"keypoints"},
    ("framing", "faithful"): {"keypoints"},
    ("camera_angle", "robust"): {"orientation"},
    ("camera_angle", "faithful"): {"orientation"},
    ("camera_movement", "faithful"): {"flow"},
    ("camera_movement", "robust"): set(),
    ("filmic_space", "robust"): set(),
    ("filmic_space", "faithful"): set(),
}


@pytest.mark.parametrize(("name", "mode"), REACHED)
def test_gradients_reach_what_the_readme_says(name: str, mode: str) -> None:
    reference, rendered = sample_features(0, 4), sample_features(1, 4)
    values = {n: getattr(rendered, n) for n in NAMES if isinstance(getattr(rendered, n), Tensor)}
    leaves = {n: value.clone().requires_grad_() for n, value in values.items() if value.is_floating_point()}
    loss = LOSSES.build(name, {"mode": mode})(reference, replace(rendered, **leaves))
    assert loss.shape == (4,)
    assert loss.requires_grad == bool(REACHED[name, mode])
    if loss.requires_grad:
        loss.sum().backward()
    slopes = {n: leaf.grad for n, leaf in leaves.items() if leaf.grad is not None}
    assert slopes.keys() == REACHED[name, mode]
    for slope in slopes.values():
        assert bool(torch.isfinite(slope).all())
        assert bool((slope.flatten(1) != 0).any(1).all())  # of every frame


def _flow(what: str) -> tuple[Features, Features]:
    """A reference and a render of which ``what`` is the matter with the flow."""
    reference, rendered = sample_features(0, 4), sample_features(1, 4)
    a, b, layers = (
        x.clone() for x in (reference.require("flow"), rendered.require("flow"), rendered.require("layers"))
    )
    if what == "equal":
        b = a.clone()
    elif what == "still":
        a, b = torch.zeros_like(a), torch.zeros_like(b)
    elif what == "equal in a part":
        b[:, :, :9, :20] = a[:, :, :9, :20]
    elif what == "pixels without a flow":
        a[:, :, 1::5], b[:, :, ::2, 1::3] = torch.nan, torch.nan
    elif what == "infinite":
        b[:, 0, ::4] = torch.inf
    elif what == "equal where no layer is":
        layers[..., :9, :], b[:, :, :9] = False, a[:, :, :9]
    elif what == "a layer is missing":
        layers[:, 0] = False
    return replace(reference, flow=a), replace(rendered, flow=b, layers=layers)


@pytest.mark.parametrize("layered", [True, False])
@pytest.mark.parametrize(
    "what",
    [
        "equal",
        "still",
        "equal in a part",
        "pixels without a flow",
        "infinite",
        "equal where no layer is",
        "a layer is missing",
    ],
)
def test_a_movement_that_has_a_value_has_finite_gradients(what: str, layered: bool) -> None:
    reference, rendered = _flow(what)
    leaf = rendered.require("flow").requires_grad_()
    loss = LOSSES.build("camera_movement", {"mode": "faithful", "layered": layered})(reference, rendered)
    assert bool(loss.isfinite().all())
    with torch.autograd.set_detect_anomaly(True):  # nor is a step on the way NaN
        loss.sum().backward()
    assert leaf.grad is not None
    assert bool(leaf.grad.isfinite().all())
    assert bool((leaf.grad != 0).any()) == (what not in ("equal", "still"))


@pytest.mark.parametrize(("name", "mode"), [key for key, reached in REACHED.items() if reached])
def test_a_render_that_is_the_reference_has_finite_gradients(name: str, mode: str) -> None:
    (reached,) = REACHED[name, mode]
    reference = sample_features(0, 4)
    leaf = getattr(reference, reached).clone().requires_grad_()
    loss = LOSSES.build(name, {"mode": mode})(reference, replace(reference, **{reached: leaf}))
    assert bool((loss == 0).all())
    loss.sum().backward()
    assert bool(leaf.grad.isfinite().all())


@pytest.mark.parametrize("mode", ["robust", "faithful"])
@pytest.mark.parametrize("name", ["shot_size", "framing"])
@pytest.mark.parametrize("side", ["reference", "rendered"])
def test_a_missing_joint_leaves_the_others_their_gradients(name: str, mode: str, side: str) -> None:
    for joint in range(14):
        reference, rendered = sample_features(0, 4), sample_features(1, 4)
        (reference if side == "reference" else rendered).require("keypoints")[:2, joint] = torch.nan
        leaf = rendered.require("keypoints").requires_grad_()
        loss = LOSSES.build(name, {"mode": mode})(reference, rendered)
        loss.nansum().backward()
        assert leaf.grad is not None
        assert bool(leaf.grad.isfinite().flatten(1).all(1)[loss.isfinite()].all())


@pytest.mark.parametrize("side", ["reference", "rendered"])
def test_an_empty_layer_leaves_the_others_their_gradients(side: str) -> None:
    depths = {"reference": torch.tensor([[1.0, 2.0, 5.0]]), "rendered": torch.tensor([[1.0, 2.0, 4.0]])}
    depths[side][0, 0] = torch.nan
    rendered = depths["rendered"].requires_grad_()
    filmic_space_loss(depths["reference"], rendered).sum().backward()
    torch.testing.assert_close(rendered.grad, torch.tensor([[0.0, 0.5, -0.25]]))


def test_a_frame_without_a_value_takes_no_other_ones_gradient() -> None:
    reference, rendered = sample_features(0, 4), sample_features(1, 4)
    reference.require("flow")[0] = torch.nan
    loss, flow = LOSSES.build("camera_movement", {"mode": "faithful"}), rendered.require("flow").clone()
    flow[0] = torch.nan
    for start in (0, 1):
        leaf = flow.clone().requires_grad_()
        loss(reference[start:], replace(rendered, flow=leaf)[start:]).nansum().backward()
        assert leaf.grad is not None
        assert bool(leaf.grad[1:].isfinite().all())
        assert bool((leaf.grad[1:] != 0).flatten(1).any(1).all())


@pytest.mark.parametrize("what", ["pixels without a flow", "equal", "still"])
def test_a_flow_of_jaws_that_has_a_value_has_finite_gradients(what: str) -> None:
    reference, rendered = _flow(what)
    flow = rendered.require("flow").requires_grad_()
    value = LOSSES.build("jaws_flow")(reference, replace(rendered, flow=flow))
    assert bool(value.isfinite().all())
    value.sum().backward()
    assert flow.grad is not None
    assert bool(flow.grad.isfinite().all())


@pytest.mark.parametrize("kind", [torch.int16, torch.int32, torch.int64])
@pytest.mark.parametrize(
    ("name", "mode"), [("camera_movement", "robust"), ("camera_movement", "faithful"), ("jaws_flow", "")]
)
def test_a_flow_may_be_of_whole_pixels(name: str, mode: str, kind: torch.dtype) -> None:
    reference, rendered = (replace(sample_features(seed, 2), size=(640, 360)) for seed in (0, 1))
    whole = [replace(side, flow=(10 * side.require("flow")).round()) for side in (reference, rendered)]
    loss = LOSSES.build(name, {"mode": mode} if mode else {})
    value = loss(*(replace(side, flow=side.require("flow").to(kind)) for side in whole))
    assert bool((value > 0).all())
    torch.testing.assert_close(value, loss(*whole), check_dtype=False)


@pytest.mark.parametrize("half", [torch.float16, torch.bfloat16])
@pytest.mark.parametrize(("name", "feature"), [("camera_movement", "flow"), ("filmic_space", "depth")])
def test_a_network_may_give_half_precision(name: str, feature: str, half: torch.dtype) -> None:
    reference, rendered = sample_features(0, 4), sample_features(1, 4)
    loss, read = LOSSES.build(name), rendered.require(feature)
    value = loss(reference, replace(rendered, **{feature: read.to(half)}))
    torch.testing.assert_close(value, loss(reference, replace(rendered, **{feature: read.to(half).float()})))
