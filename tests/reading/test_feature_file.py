"""A feature file: saved and read back, refused by field when damaged."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from cltransfer.errors import InputError
from cltransfer.features import Features
from cltransfer.reading.feature_file import FORMAT, FeatureFile


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


@pytest.mark.parametrize(
    ("meta", "line"),
    [
        ({"format": "cltransfer.features.9"}, r"got 'cltransfer.features.9' \(another version has written it, .* anew"),
        ({}, r"got None \(docs/python.md writes one\)$"),
    ],
)
def test_a_feature_file_of_another_format_is_told_where_one_comes_from(
    tmp_path: Path, meta: dict[str, str], line: str
) -> None:
    save_file({"times": torch.tensor([0.0, 1.0])}, tmp_path / "a.safetensors", metadata=meta)
    with pytest.raises(InputError, match=rf"format: expected 'cltransfer.features.1', {line}"):
        FeatureFile.load(tmp_path / "a.safetensors")


def test_tensors_that_no_feature_is_called_like_are_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    joints = torch.ones(2, 14, 3)
    found = kept(tmp_path / "a", box=torch.ones(2, 5), key_points=joints, gaze_point=torch.ones(2, 3))
    assert found.names() == {"box"}
    said = "gaze_point, key_points: are no features and left out (did you mean 'extras.gaze_point'?)"
    assert caplog.messages == [f"{tmp_path / 'a'}: {said}"]
    caplog.clear()
    assert kept(tmp_path / "a", box=torch.ones(2, 5), **{"extras.gaze": joints}).names() == {"box", "gaze"}
    assert caplog.messages == []
    with pytest.raises(InputError, match=r"expected at least one, it holds times, key_points alone$"):
        kept(tmp_path / "a", key_points=joints)


def test_a_slip_is_told_beside_what_is_like_no_feature_at_all(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    kept(tmp_path / "a", box=torch.ones(2, 5), audio=torch.ones(2), keypoint=torch.ones(2, 14, 3))
    said = "audio, keypoint: are no features and left out (did you mean 'keypoints'?)"
    assert caplog.messages == [f"{tmp_path / 'a'}: {said}"]
    caplog.clear()
    kept(tmp_path / "a", box=torch.ones(2, 5), audio=torch.ones(2), text=torch.ones(2))
    (line,) = caplog.messages
    assert line.startswith(f"{tmp_path / 'a'}: audio, text: are no features and left out (known: box, ")


def test_what_no_feature_is_called_like_may_be_of_any_length(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    assert kept(tmp_path / "a", box=torch.ones(2, 5), step=torch.tensor(0), key_points=torch.ones(7)).names() == {"box"}
    said = "key_points, step: are no features and left out (did you mean 'keypoints'?)"
    assert caplog.messages == [f"{tmp_path / 'a'}: {said}"]
    with pytest.raises(InputError, match=r"extras\.step: expected 2 frames, got a single value"):
        kept(tmp_path / "a", **{"extras.step": torch.tensor(0)})


def test_of_names_that_are_no_feature_s_a_few_are_told_on_one_line_and_cut(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    foreign = {f"{i}\n error: {'x' * 1000}": torch.ones(2) for i in range(9)}
    assert kept(tmp_path / "a", box=torch.ones(2, 5), **foreign).names() == {"box"}
    shown = ", ".join(f"{i} error: {'x' * 31}..." for i in range(5))
    (line,) = caplog.messages
    assert line.startswith(f"{tmp_path / 'a'}: {shown}, 4 more: are no features and left out (did you mean ")
    assert "\n" not in line
    with pytest.raises(InputError) as caught:
        kept(tmp_path / "a", **foreign)
    assert caught.value.reason == f"expected at least one, it holds times, {shown}, 4 more alone"


def test_a_feature_file_may_be_named_by_a_text(tmp_path: Path) -> None:
    path = str(tmp_path / "clip.safetensors")
    FeatureFile(Features((8, 4), keypoints=torch.rand(2, 14, 3)), torch.tensor([0.0, 0.5]).double(), "").save(path)
    FeatureFile.load(path)
    with pytest.raises(InputError, match="no such file"):
        FeatureFile.load(f"{path}.lost")


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


def test_times_of_a_type_that_counts_no_seconds_are_refused(tmp_path: Path) -> None:
    for dtype in (torch.float8_e4m3fn, torch.float8_e5m2, torch.bool, torch.complex64):
        with pytest.raises(InputError, match=r"times: expected a list of increasing times \(store them as float64\)"):
            kept(tmp_path / "a", keypoints=torch.ones(2, 14, 3), times=torch.tensor([0.0, 1.0]).to(dtype))
    for dtype in (torch.uint8, torch.uint64, torch.float16, torch.bfloat16):
        kept(tmp_path / "a", keypoints=torch.ones(2, 14, 3), times=torch.tensor([0.0, 1.0]).to(dtype))


def test_masks_and_short_floats_of_a_feature_file_get_the_type_they_have_in_features(tmp_path: Path) -> None:
    mask = torch.eye(4, 8).expand(2, 4, 8).contiguous()
    for dtype in (torch.bool, torch.uint8):
        assert torch.equal(kept(tmp_path / "a", subject=mask.to(dtype)).require("subject"), mask.bool())
    for dtype, want in ((torch.float16, torch.float32), (torch.float32, torch.float32), (torch.float64, torch.float64)):
        assert kept(tmp_path / "a", depth=mask.to(dtype)).require("depth").dtype is want


def test_a_feature_file_that_another_is_copied_over_changes_nothing_that_was_read(tmp_path: Path) -> None:
    path, mask = tmp_path / "a", torch.eye(4, 8).expand(2, 4, 8).contiguous()
    given = {"depth": mask + 1, "subject": mask.bool(), "orientation": torch.rand(2, 3).double()}
    save_file({"times": torch.tensor([0.0, 1.0]).double(), **given}, path, {"format": FORMAT, "size": "[8, 4]"})
    found = FeatureFile.load(path)
    with path.open("r+b") as stream:  # as cp does, which keeps the file and writes into it
        stream.write(b"\1" * path.stat().st_size)
    assert found.times.tolist() == [0, 1]
    for name, value in given.items():
        assert torch.equal(found.features.require(name), value)


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


def test_values_of_another_unit_are_refused_with_what_to_do(tmp_path: Path) -> None:
    path = tmp_path / "features.safetensors"
    degrees = torch.tensor([[90.0, 0.0, 0.0], [100.0, 5.0, 0.0]])
    FeatureFile(Features((64, 36), orientation=degrees), torch.tensor([0.0, 1.0]), "mine").save(path)
    with pytest.raises(InputError, match=r"orientation: expected radians, got a yaw of 100 \(wrap it, or torch"):
        FeatureFile.load(path)
