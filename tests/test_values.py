"""Features, Subject, Trajectory and the skeleton: what flows, saved and read back, refused when damaged."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from cltransfer.camera import Camera
from cltransfer.errors import InputError
from cltransfer.features import Features
from cltransfer.reading.feature_file import FORMAT, FeatureFile
from cltransfer.skeleton import HEAD_TOP_BEYOND_EARS, JOINTS, from_blazepose, from_coco, key_joints
from cltransfer.subject import Subject
from cltransfer.trajectory import Trajectory


def subject() -> Subject:
    joints = torch.arange(42, dtype=torch.float64).reshape(14, 3)
    joints[3] = torch.nan
    confidence = torch.ones(14, dtype=torch.float64)
    confidence[3] = 0
    facing, up = torch.eye(3, dtype=torch.float64)[[0, 2]]
    return Subject(joints, confidence, facing, up, 1.7, 1.0)


def trajectory() -> Trajectory:
    eye = torch.tensor([[3.0, 0, 1], [3, 0.5, 1], [3, 1, 1]])
    camera = Camera.look_at(eye, torch.zeros(1, 3), torch.tensor([0.0, 0, 1]), 0.7, (64, 36))
    return Trajectory(camera, torch.tensor([0.0, 0.1, 0.2], dtype=torch.float64))


def test_a_subject_comes_back_and_an_unknown_joint_is_null(tmp_path: Path) -> None:
    subject().save(tmp_path / "subject.json", note="a report")
    assert json.loads((tmp_path / "subject.json").read_text())["joints"]["right_elbow"] is None
    again = Subject.load(tmp_path / "subject.json")
    torch.testing.assert_close(again.joints, subject().joints, equal_nan=True)
    assert again.height == 1.7


def test_left_is_left_of_facing() -> None:
    torch.testing.assert_close(subject().left, torch.tensor([0.0, 1, 0], dtype=torch.float64))  # x ahead, z up


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "other"}, "format: expected 'cltransfer.subject'"),
        ({"facing": [2, 0, 0]}, "facing: expected a unit vector"),
        ({"height": -1}, "height must be positive"),
        ({"height": 10**400}, "not a subject: int too large"),
        ({"metres_per_unit": -1}, "metres_per_unit: expected a number above 0 or null, got -1.0"),
        ({"metres_per_unit": 0}, "metres_per_unit: expected a number above 0 or null, got 0.0"),
        ({"metres_per_unit": math.inf}, "metres_per_unit: expected a number above 0 or null, got inf"),
        ({"up": [1, 0]}, "up must be"),
        ({"joints": {}}, "left_shoulder: field is missing"),
    ],
)
def test_a_damaged_subject_is_refused_by_field(tmp_path: Path, change: dict, message: str) -> None:
    path = tmp_path / "subject.json"
    path.write_text(json.dumps({**subject().to_json(), **change}))
    with pytest.raises(InputError) as caught:
        Subject.load(path)
    assert message in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_trajectory_comes_back_exactly(tmp_path: Path) -> None:
    trajectory().save(tmp_path / "t.json")
    again = Trajectory.load(tmp_path / "t.json")
    assert torch.equal(again.camera.w2c, trajectory().camera.w2c)
    assert torch.equal(again.camera.K, trajectory().camera.K)
    assert again.fps == pytest.approx(10)


def test_a_file_may_be_named_by_a_text(tmp_path: Path) -> None:
    features = FeatureFile(Features((8, 4), keypoints=torch.rand(3, 14, 3)), trajectory().times[:3], "")
    for value, name in ((trajectory(), "t.json"), (subject(), "subject.json"), (features, "clip.safetensors")):
        path = str(tmp_path / name)
        value.save(path)
        type(value).load(path)
        with pytest.raises(InputError, match="no such file"):
            type(value).load(f"{path}.lost")


def test_a_damaged_trajectory_is_refused_by_field(tmp_path: Path) -> None:
    path = tmp_path / "t.json"
    good = trajectory().to_json()

    def refuse(message: str, **change: object) -> None:
        path.write_text(json.dumps({**good, **change}))
        with pytest.raises(InputError, match=message):
            Trajectory.load(path)

    mirrored = json.loads(json.dumps(good["frames"]))
    mirrored[1]["w2c"][0][0] *= -1
    backwards = json.loads(json.dumps(good["frames"]))
    backwards[1]["time"] = 9.0
    refuse("expected rotations", frames=mirrored)
    refuse("times must increase", frames=backwards)
    refuse("expected a list of 1 to 2000", frames=[])
    for size in ("wide", [math.inf, 90], [160.5, 90], [10**400, 90], [0, 90], [True, 90], [160], None):
        refuse("size: expected a width and a height, whole numbers in", size=size)

    def changed(number: int, **fields: object) -> list[dict[str, object]]:
        return [{**frame, **(fields if i == number else {})} for i, frame in enumerate(good["frames"])]

    refuse("time: expected finite numbers", frames=changed(2, time=math.inf))
    refuse("time: expected at most 1e[+]09 s", frames=changed(2, time=1e300))
    soon = good["frames"][0]["time"] + 1e-9
    refuse("time: expected at most 1e[+]09 s, in steps of 1e-06 s", frames=changed(1, time=soon))
    refuse("not a trajectory", frames=changed(2, time=10**400))
    refuse(
        "w2c: expected 0 0 0 1 as the last row", frames=changed(1, w2c=[*good["frames"][1]["w2c"][:3], [0, 0, 0, 2]])
    )
    K = good["frames"][1]["K"]
    refuse("K: expected no skew", frames=changed(1, K=[[K[0][0], 0.1, K[0][2]], *K[1:]]))
    refuse("K: expected no skew", frames=changed(1, K=[K[0], [0.1, *K[1][1:]], K[2]]))
    refuse("K: expected 0 0 1 as the last row", frames=changed(1, K=[*good["frames"][1]["K"][:2], [0, 0.1, 1]]))


def test_key_joints_are_midpoints_of_crowdpose_joints() -> None:
    keypoints = torch.rand(3, 14, 3, generator=torch.Generator().manual_seed(0))
    at = {n: keypoints[:, i] for i, n in enumerate(JOINTS)}
    expected = (at["left_hip"] + at["right_hip"])[:, :2] / 2
    torch.testing.assert_close(key_joints(keypoints)[:, 2, :2], expected)
    torch.testing.assert_close(key_joints(keypoints)[:, 0], at["head_top"])


@pytest.mark.parametrize(
    ("convert", "count", "ears", "shoulders"), [(from_coco, 17, 3, 5), (from_blazepose, 33, 7, 11)]
)
def test_the_head_top_lies_beyond_the_ears_by_one_rule(convert, count: int, ears: int, shoulders: int) -> None:
    keypoints = torch.ones(1, count, 3)
    keypoints[0, ears : ears + 2, 1] = 10.0
    keypoints[0, shoulders : shoulders + 2, 1] = 20.0
    top = convert(keypoints)[0, JOINTS.index("head_top")]
    assert float(top[1]) == pytest.approx(10 - HEAD_TOP_BEYOND_EARS * 10)


def test_features_index_concatenate_and_require() -> None:
    features = Features((4, 2), image=torch.rand(3, 3, 2, 4), extras={"gaze": torch.rand(3, 2)})
    assert len(features[1]) == 1
    joined = Features.concatenate([features[0], features[1:]])
    assert torch.equal(joined.require("gaze"), features.require("gaze"))
    with pytest.raises(KeyError, match="feature 'depth' was not extracted; add an extractor"):
        features.require("depth")


def test_a_feature_file_comes_back_and_a_foreign_one_is_refused(tmp_path: Path) -> None:
    features = Features((8, 4), keypoints=torch.rand(2, 14, 3), layers=torch.zeros(2, 3, 4, 8, dtype=torch.bool))
    features = replace(features, reasons={"depth": "the camera stands still"})
    path = tmp_path / "clip.safetensors"
    FeatureFile(features, torch.tensor([0.0, 0.5], dtype=torch.float64), "clip.mp4").save(path)
    again = FeatureFile.load(path)
    assert torch.equal(again.features.require("keypoints"), features.require("keypoints"))
    assert again.features.size == (8, 4)
    assert again.features.reasons == {"depth": "the camera stands still"}
    path.write_bytes(b"\xff" * 100)
    with pytest.raises(InputError, match="not a feature file"):
        FeatureFile.load(path)


def test_a_feature_file_of_unequal_lengths_is_refused_by_tensor(tmp_path: Path) -> None:
    path = tmp_path / "clip.safetensors"
    times = torch.tensor([0.0, 0.5], dtype=torch.float64)
    FeatureFile(Features((8, 4), keypoints=torch.rand(3, 14, 3)), times, "").save(path)
    with pytest.raises(InputError, match="keypoints: expected 2 frames, got 3"):
        FeatureFile.load(path)


def kept(path: Path, **tensors: torch.Tensor) -> Features:
    """Features of two frames of 8x4 with these tensors, as they come back from a file."""
    times = {"times": torch.tensor([0.0, 1.0])}
    save_file({**times, **tensors}, path, metadata={"format": FORMAT, "size": "[8, 4]"})
    return FeatureFile.load(path).features


def test_a_feature_file_of_times_alone_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"features: expected at least one, it holds times alone"):
        kept(tmp_path / "times.safetensors")


def test_times_that_go_back_are_refused_of_any_type(tmp_path: Path) -> None:
    for dtype in (torch.uint8, torch.int32, torch.float32):
        with pytest.raises(InputError, match="expected a list of increasing times"):
            kept(tmp_path / "a", times=torch.tensor([10, 5], dtype=dtype))


def test_masks_and_short_floats_of_a_feature_file_get_the_type_they_have_in_features(tmp_path: Path) -> None:
    mask = torch.eye(4, 8).expand(2, 4, 8).contiguous()
    for dtype in (torch.bool, torch.uint8):
        assert torch.equal(kept(tmp_path / "a", subject=mask.to(dtype)).require("subject"), mask.bool())
    for dtype, want in ((torch.float16, torch.float32), (torch.float32, torch.float32), (torch.float64, torch.float64)):
        assert kept(tmp_path / "a", depth=mask.to(dtype)).require("depth").dtype is want


def test_layers_that_are_checked_take_no_more_memory_than_they_have(tmp_path: Path) -> None:
    made = []

    class Told(TorchDispatchMode):
        def __torch_dispatch__(self, func, types, args=(), kwargs=None):
            result = func(*args, **(kwargs or {}))
            made.extend(one.nbytes for one in tree_leaves(result) if isinstance(one, torch.Tensor))
            return result

    layers = torch.eye(3, 4).bool().reshape(1, 3, 4, 1).expand(2, 3, 4, 8).contiguous()
    with Told():
        assert torch.equal(kept(tmp_path / "a", layers=layers).require("layers"), layers)
    assert max(made) <= layers.nbytes


@pytest.mark.parametrize(
    ("field", "tensors", "reason"),
    [
        ("layers", {"layers": torch.ones(2, 3, 4, 8)}, "expected bool, or uint8 of 0 and 1, got float32"),
        ("subject", {"subject": torch.full((2, 4, 8), 255, dtype=torch.uint8)}, "got uint8"),
        ("keypoints", {"keypoints": torch.ones(2, 14, 3, dtype=torch.int32)}, "expected floats, got int32"),
        ("flow_confidence", {"flow": torch.ones(2, 2, 4, 8), "flow_confidence": torch.ones(2, 2, 4)},
         "expected the 8x4 pixels of flow, got 4x2"),
        ("layers", {"layers": torch.ones(2, 3, 4, 8, dtype=torch.bool)},
         "expected each pixel in one layer at most, frame 0 has one in two"),
        ("extras.keypoints", {"keypoints": torch.ones(2, 14, 3), "extras.keypoints": torch.ones(2, 3)},
         r"is a feature of its own, not an extra \(store it as keypoints\)"),
        ("extras.image", {"keypoints": torch.ones(2, 14, 3), "extras.image": torch.ones(2, 3)},
         r"is a feature of its own, not an extra \(leave it out\)"),
    ],
)  # fmt: skip
def test_tensors_of_a_wrong_type_or_on_unlike_grids_are_refused_by_name(
    tmp_path: Path, field: str, tensors: dict[str, torch.Tensor], reason: str
) -> None:
    with pytest.raises(InputError, match=reason) as caught:
        kept(tmp_path / "a", **tensors)
    assert caught.value.field == field


def test_maps_of_a_feature_file_may_have_fewer_pixels_than_one_another(tmp_path: Path) -> None:
    layers = torch.eye(3, 4).bool().reshape(1, 3, 4, 1).expand(2, 3, 4, 8).contiguous()
    maps = {"layers": layers, "subject": layers[:, 1, ::2, ::2].contiguous(), "depth": torch.ones(2, 1, 2)}
    features = kept(tmp_path / "a", **maps, flow=torch.ones(2, 2, 2, 4))
    assert {name: torch.equal(features.require(name), value) for name, value in maps.items()} == dict.fromkeys(
        maps, True
    )


@pytest.mark.parametrize(
    ("tensors", "size", "field"),
    [
        ({"times": torch.tensor([0.0, torch.nan])}, "[8, 8]", "times"),
        ({"times": torch.tensor([0.0, 1.0]), "depth": torch.tensor(1.0)}, "[8, 8]", "depth"),
        ({"times": torch.tensor([0.0, 1.0])}, "[1e999, 1]", "size"),
        ({"times": torch.tensor([0.0, 1.0])}, "[0, -4]", "size"),
        *(
            ({"times": torch.tensor([0.0, 1.0]), "depth": torch.ones(2, 4, 8)}, size, "size")
            for size in (
                f"[1{'0' * 400}, 480]",
                "[1000000000000, 480]",
                "[640.9, 480]",
                '["640", "480"]',
                "[true, true]",
                "[8, 4, 2]",
                '{"8": 4, "4": 8}',
            )
        ),
        ({"times": torch.tensor([0.0, 1.0]), "depth": torch.ones(2, 0, 0)}, "[8, 8]", "depth"),
    ],
)
def test_a_feature_file_that_no_clip_can_have_is_refused_by_field(
    tmp_path: Path, tensors: dict[str, torch.Tensor], size: str, field: str
) -> None:
    path = tmp_path / "clip.safetensors"
    save_file(tensors, path, metadata={"format": FORMAT, "size": size})
    with pytest.raises(InputError) as caught:
        FeatureFile.load(path)
    assert caught.value.field == field


@pytest.mark.parametrize("field", ["size", "reasons"])
def test_a_feature_file_of_endless_brackets_is_refused_by_field(tmp_path: Path, field: str) -> None:
    meta = {"format": FORMAT, "size": "[8, 8]", field: "[" * 20000 + "]" * 20000}
    save_file({"times": torch.tensor([0.0, 1.0])}, tmp_path / "clip.safetensors", metadata=meta)
    with pytest.raises(InputError) as caught:
        FeatureFile.load(tmp_path / "clip.safetensors")
    assert caught.value.field == field
