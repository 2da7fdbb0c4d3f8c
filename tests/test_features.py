"""Features: values by name, one frame at a time without a copy, what is asked of them often computed once."""

from __future__ import annotations

import itertools
import pickle
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from cltransfer import LOSSES
from cltransfer.feature_shapes import on_grid
from cltransfer.features import Features
from cltransfer.reading.feature_file import FeatureFile
from cltransfer.testing.samples import sample_cameras, sample_features, sample_subject
from cltransfer.trajectory import Trajectory


def test_a_feature_is_set_and_taken_away_by_name_be_it_a_plugin_s_or_not() -> None:
    features = sample_features(0, 2).having("heat", torch.ones(2, 3))
    assert features.has("heat")
    assert features.extras["heat"].shape == (2, 3)
    assert not features.having("heat", None).has("heat")
    assert not features.having("depth", None).has("depth")
    assert torch.equal(features.having("depth", features.require("depth") + 1).require("depth"), features.depth + 1)


def test_only_what_is_named_stays() -> None:
    features = sample_features(0, 2).having("heat", torch.ones(2, 3)).having("cold", torch.ones(2, 3))
    assert features.only({"depth", "heat", "elsewhere"}).names() == {"depth", "heat"}
    for name in ("depth", "heat"):
        assert features.only(name).names() == {name}  # and not of the names d, e, p, t, h


def test_one_frame_is_a_batch_of_one_that_shares_memory() -> None:
    features = sample_features(0, 3).having("heat", torch.arange(6.0).reshape(3, 2))
    for i in (0, 2, -1):
        frame = features[i]
        assert len(frame) == 1
        assert frame is features[i]
        assert torch.equal(frame.require("heat")[0], features.extras["heat"][i])
    assert features[1].require("depth").data_ptr() == features.require("depth")[1].data_ptr()
    assert torch.equal(features[[2, 0]].require("heat"), features.extras["heat"][[2, 0]])


@pytest.mark.parametrize("one", [1, -2, np.int64(1), np.int32(-2), torch.tensor(1), np.array(1), True])
def test_an_integer_of_any_kind_is_a_batch_of_one(one: Any) -> None:
    features = sample_features(0, 3)
    frame = features[one]
    assert frame is features[1 if int(one) == 1 else -2]
    assert torch.equal(frame.require("depth"), features.require("depth")[1:2])
    assert torch.equal(features.require("camera")[one].w2c, features.require("camera").w2c[1:2])


@pytest.mark.parametrize("several", [(0, 2), [0, 2], range(0, 3, 2), np.array([0, 2]), torch.tensor([0, 2]),
                                     (np.int64(0), torch.tensor(2)), [True, False, True]])  # fmt: skip
def test_a_sequence_of_any_kind_is_taken_along_the_batch(several: Any) -> None:
    features = sample_features(0, 3)
    for part in (features[several], features.only({"depth", "camera"})[several]):
        assert torch.equal(part.require("depth"), features.require("depth")[[0, 2]])
        assert torch.equal(part.require("camera").K, features.require("camera").K[[0, 2]])
    assert len(features[()]) == len(features.require("camera")[()]) == 0


def test_frames_end_where_there_are_no_more() -> None:
    features: Any = sample_features(0, 3)
    assert [frame is features[i] for i, frame in enumerate(itertools.islice(features, 9))] == [True] * 3
    assert not isinstance(features, Iterable)  # Lightning would look for the size of a batch in it without end
    for beyond in (3, -4):
        with pytest.raises(IndexError, match=rf"^expected a frame from -3 to 2, got {beyond}$"):
            features[beyond]


def test_a_batch_of_frames_of_two_persons_is_of_neither() -> None:
    one, other = sample_features(0, 1), replace(sample_features(1, 1), person=replace(sample_subject(), height=3.0))
    assert Features.concatenate([one, one[:1]]).person is one.person
    assert not Features.concatenate([one, other]).has("person")


def test_frames_that_are_no_batch_are_told_apart() -> None:
    one, none = sample_features(0, 1), "features of a batch must be of one size and have the same names and shapes"
    with pytest.raises(ValueError, match=rf"^{none}, got \(64, 36\) and \(32, 18\); give all clips one size$"):
        Features.concatenate([one, replace(one, size=(32, 18))])
    with pytest.raises(ValueError, match=rf"^{none}, not all have depth, flow; leave them out with only$"):
        Features.concatenate([one, replace(one, depth=None), replace(one, flow=None)])
    beats = [one.having("beat", torch.zeros(1, width)) for width in (3, 2, 3)]
    with pytest.raises(ValueError, match=rf"^{none}, beat has \(3,\) and \(2,\) a frame; read all of them by one extr"):
        Features.concatenate(beats)
    coarse = one.having("depth", one.require("depth")[:, ::2, ::2])
    with pytest.raises(ValueError, match=rf"^{none}, depth has \(36, 64\) and \(18, 32\) a frame; "):
        Features.concatenate([one, coarse])
    assert len(Features.concatenate([coarse, coarse])) == 2
    with pytest.raises(ValueError, match=f"^{none}, got no frames$"):
        Features.concatenate([])


def test_what_is_asked_of_features_is_computed_once_and_not_for_others_made_of_them() -> None:
    features, asked = sample_features(0, 2), []

    def compute() -> int:
        asked.append(1)
        return len(asked)

    assert [features.once("a", compute), features.once("a", compute), features.once("b", compute)] == [1, 1, 2]
    assert features.having("depth", None).once("a", compute) == 3


def test_tensors_changed_in_place_are_other_features() -> None:
    features = sample_features(0, 2)
    frame, depth = features[0], features.require("depth")
    mean = frame.once("mean", lambda: float(frame.require("depth").nanmean()))
    depth += 1
    assert frame.once("mean", lambda: float(frame.require("depth").nanmean())) > mean


def test_of_what_was_made_in_inference_mode_nothing_is_kept() -> None:
    """Such tensors do not tell that they were changed in place."""
    reference, given = sample_features(0, 4), sample_features(1, 4)
    loss = LOSSES.build("framing")
    with torch.inference_mode():
        keypoints = given.require("keypoints").clone()
        rendered = replace(given, keypoints=keypoints)
        loss(reference, rendered)
        keypoints += 30
        again = loss(reference, rendered)
    torch.testing.assert_close(again, loss(reference, replace(given, keypoints=keypoints.clone())))


def test_a_copy_sent_elsewhere_brings_no_frames_that_were_looked_at() -> None:
    features = sample_features(0, 8)
    size = len(pickle.dumps(features))
    for i in range(8):
        features[i]
    sent = pickle.dumps(features)
    assert len(sent) == size
    torch.testing.assert_close(pickle.loads(sent)[3].keypoints, features[3].keypoints)


@pytest.mark.parametrize("name", ["subject", "layers"])
def test_a_mask_of_numbers_is_refused_with_what_to_do(name: str) -> None:
    """~ of a mask of bytes is no other mask: 1 becomes 254."""
    features = sample_features(0, 2)
    with pytest.raises(TypeError, match=f"{name} must be bool, got torch.uint8; {name} > 0.5 makes it so"):
        replace(features, **{name: features.require(name).to(torch.uint8)})


def test_of_what_asks_for_a_gradient_nothing_is_kept() -> None:
    features = sample_features(0, 2)
    joints = features.require("keypoints").clone().requires_grad_()
    features = features.having("keypoints", joints)
    for _ in range(2):
        features.once("sum", lambda: features.require("keypoints").nansum()).backward()
    assert joints.grad is not None


def test_features_go_to_a_device_with_all_their_tensors() -> None:
    features = sample_features(0, 2).having("heat", torch.ones(2, 3))
    gone = features.to("meta")
    tensors = features.names() - {"camera", "person"}
    assert {gone.require(name).device.type for name in tensors} == {"meta"}
    assert (gone.size, gone.person) == (features.size, features.person)
    assert torch.equal(gone.require("camera").w2c, features.require("camera").w2c)
    assert {features.require(name).device.type for name in tensors} == {"cpu"}


def test_features_keep_their_types_and_come_back_to_the_cpu() -> None:
    features = sample_features(0, 2)
    with pytest.raises(TypeError, match=r"got torch\.float64: features keep their types"):
        features.to(torch.float64)
    there = features.to("cpu", non_blocking=True).cpu()
    assert torch.equal(there.require("keypoints"), features.require("keypoints"))
    assert there.names() == features.names()


def test_detached_features_are_the_same_without_gradients() -> None:
    features = sample_features(0, 2)
    camera, depth = features.require("camera"), features.require("depth").clone().requires_grad_()
    camera = replace(camera, w2c=camera.w2c.clone().requires_grad_())
    features = replace(features, camera=camera, depth=depth)
    gone = features.detach()
    assert not gone.require("depth").requires_grad
    assert not gone.require("camera").w2c.requires_grad
    assert features.require("depth").requires_grad


MISSHAPEN: dict[str, tuple[dict[str, Any], str]] = {
    "COCO": (
        {"keypoints": torch.rand(4, 17, 3)},
        "keypoints must be (B, 14, 3), got (4, 17, 3); cltransfer.skeleton.from_coco makes 14 of COCO's 17",
    ),
    "BlazePose": (
        {"keypoints": torch.rand(4, 33, 3)},
        "keypoints must be (B, 14, 3), got (4, 33, 3); cltransfer.skeleton.from_blazepose makes 14 of BlazePose's",
    ),
    "no batch": (
        {"depth": torch.rand(9, 16)},
        "depth must be (B, any, any), got (9, 16); add a batch dimension",
    ),
    "channels last": (
        {"flow": torch.rand(4, 9, 16, 2)},
        "flow must be (B, 2, any, any), got (4, 9, 16, 2); see the fields of Features",
    ),
    "numpy": (
        {"orientation": np.zeros((4, 3))},
        "orientation must be a tensor (B, 3), got ndarray; torch.as_tensor makes one",
    ),
    "lengths": (
        {"keypoints": torch.rand(4, 14, 3), "flow": torch.rand(3, 2, 9, 16)},
        "features must have one number of frames, got 4 in keypoints and 3 in flow",
    ),
    "cameras": (
        {"keypoints": torch.rand(4, 14, 3), "camera": sample_cameras(0, 2)},
        "features must have one number of frames, got 4 in keypoints and 2 in camera",
    ),
    "a plugin's single value": (
        {"keypoints": torch.rand(4, 14, 3), "extras": {"gaze": torch.tensor(1.0)}},
        "gaze must be a tensor with one row a frame, got a single value; add a batch dimension",
    ),
    "a plugin's number": (
        {"extras": {"gaze": 0.5}},
        "gaze must be a tensor with one row a frame, got float; torch.as_tensor makes one",
    ),
    "a plugin's own": (
        {"extras": {"gaze": torch.rand(4, 2), "heat": torch.rand(5)}},
        "features must have one number of frames, got 4 in gaze and 5 in heat",
    ),
}


def test_an_image_of_bytes_is_refused() -> None:
    with pytest.raises(TypeError, match=r"^image must be RGB in \[0, 1\], got torch.uint8; image / 255 makes it so"):
        Features((4, 4), image=torch.zeros(1, 3, 4, 4, dtype=torch.uint8))


@pytest.mark.parametrize("case", MISSHAPEN)
def test_a_field_of_another_shape_is_refused_with_what_to_do(case: str) -> None:
    fields, line = MISSHAPEN[case]
    with pytest.raises((ValueError, TypeError)) as caught:
        Features((64, 36), **fields)
    assert str(caught.value) == line


@pytest.mark.parametrize("name", sorted(LOSSES._built_in()))
def test_a_loss_says_what_it_expected_of_what_it_cannot_compare(name: str) -> None:
    loss, features = LOSSES.build(name), sample_features(0, 4)
    with pytest.raises(TypeError, match=r"^expected Features of the reference .*, got Features and Tensor; see clip_"):
        loss(features, features.require("keypoints"))
    with pytest.raises(ValueError, match=r"the reference has 2 and the render 4$"):
        loss(features[:2], features)


@pytest.mark.parametrize("dtype", [torch.bool, torch.int32, torch.float32, torch.float64])
@pytest.mark.parametrize("each", [1, 3])
def test_maps_of_fewer_pixels_are_spread_and_keep_their_type(dtype: torch.dtype, each: int) -> None:
    maps = torch.tensor([[[0, 1], [1, 0]]]).to(dtype)
    stacked = maps if each == 1 else torch.stack([maps, 1 - maps.int(), maps], dim=1).to(dtype)
    spread = on_grid(stacked, (4, 6))
    assert spread.dtype == dtype
    assert torch.equal(spread, stacked.repeat_interleave(2, -2).repeat_interleave(3, -1))
    assert on_grid(stacked, (2, 2)) is stacked


def test_features_index_concatenate_and_require() -> None:
    features = Features((4, 2), image=torch.rand(3, 3, 2, 4), extras={"gaze": torch.rand(3, 2)})
    assert len(features[1]) == 1
    joined = Features.concatenate([features[0], features[1:]])
    assert torch.equal(joined.require("gaze"), features.require("gaze"))
    with pytest.raises(KeyError, match="feature 'depth' was not extracted; add an extractor"):
        features.require("depth")


def test_an_extra_may_not_be_called_like_a_field() -> None:
    features = sample_features(0, 2)
    with pytest.raises(ValueError, match="depth is a field of its own, expected another name among extras"):
        replace(features, extras={"depth": features.depth})
    with pytest.raises(ValueError, match="size is a field of its own"):
        features.having("size", torch.zeros(2, 1))


def test_a_person_for_a_mask_is_told_where_to_go() -> None:
    with pytest.raises(TypeError, match=r"subject must be a tensor .*, got Subject; that is the field person"):
        replace(sample_features(0, 2), subject=sample_subject())


def test_features_are_told_apart_by_which_they_are() -> None:
    one, other = sample_features(0, 2), sample_features(0, 2)
    assert one != other
    assert [one, other].index(other) == 1
    assert len({one, other}) == 2


@pytest.mark.parametrize("size", [(0, 0), (-1, 5), (64, 36, 3), None, 64, (64.0, 36.0), [64, 36]])
def test_a_size_is_two_whole_numbers_of_pixels(size: Any) -> None:
    with pytest.raises(ValueError, match=r"size must be \(W, H\), two whole numbers above 0, got"):
        replace(sample_features(0, 1), size=size)


def test_a_size_of_numpy_s_numbers_is_kept_in_files(tmp_path: Path) -> None:
    features, times = sample_features(0, 2), torch.arange(2.0)
    width, height = np.array(features.size)
    features = replace(features, size=(width, height), camera=replace(features.require("camera"), size=(width, height)))
    FeatureFile(features, times, "").save(tmp_path / "features.safetensors")
    assert FeatureFile.load(tmp_path / "features.safetensors").features.size == (64, 36)
    Trajectory(features.require("camera"), times).save(tmp_path / "trajectory.json")
    assert Trajectory.load(tmp_path / "trajectory.json").camera.size == (64, 36)


MAPS: dict[str, tuple[torch.dtype, tuple[int, ...]]] = {
    "image": (torch.float32, (3,)),
    "alpha": (torch.float32, ()),
    "label": (torch.int64, ()),
    "depth": (torch.float32, ()),
    "expected_depth": (torch.float32, ()),
    "subject": (torch.bool, ()),
    "layers": (torch.bool, (3,)),
    "flow": (torch.float32, (2,)),
    "flow_confidence": (torch.float32, ()),
}


@pytest.mark.parametrize("name", MAPS)
def test_a_size_of_rows_and_columns_is_told_from_one_of_width_and_height(name: str) -> None:
    kind, channels = MAPS[name]
    there = {name: torch.zeros(1, *channels, 36, 64, dtype=kind)}
    for size in ((64, 36), (1280, 720), (36, 36), (65, 36), (np.int64(64), 36)):
        Features(size, **there)
    for size in ((36, 64), (720, 1280)):
        with pytest.raises(
            ValueError, match=rf"size must be \(W, H\), got .* where {name} has 36 rows and 64 columns;"
        ):
            Features(size, **there)


@pytest.mark.parametrize("name", MAPS)
def test_a_square_or_an_empty_map_fits_any_size(name: str) -> None:
    kind, channels = MAPS[name]
    for side in (0, 16):
        Features((36, 64), **{name: torch.zeros(1, *channels, side, side, dtype=kind)})
