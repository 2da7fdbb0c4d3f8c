"""What is refused before anything is read or searched."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from cltransfer.clips.clip import write_video
from cltransfer.config import load_config
from cltransfer.errors import CltransferError, InputError, ResourceError, UsageError
from cltransfer.features import Features
from cltransfer.progress import silent
from cltransfer.reading.feature_file import FeatureFile
from cltransfer.run.inputs import Inputs
from cltransfer.run.preparation import Clock, prepare
from cltransfer.run.record import Record
from cltransfer.testing import sample_cameras, sample_features
from cltransfer.trajectory import Trajectory

SMALL = ("preset=fast", "frames=2", "search_side=48", "output_side=64", "threads=1")


@pytest.mark.parametrize(
    ("scene", "renderer", "line"),
    [
        ("builtin:plaza-0-mesh", "gaussian_splats={}", r"does not draw Mesh \(choose: renderer\.mesh="),
        ("builtin:plaza", "mesh={}", r"does not draw Splats \(choose: renderer\.gaussian_splats="),
        ("builtin:plaza", "gaussian_splats.backend=gsplat", "renderer gaussian_splats"),
    ],
)
def test_a_renderer_that_cannot_draw_is_refused_before_anything_is_read(
    scene: str, renderer: str, line: str, tmp_path: Path
) -> None:
    """A run that lies there stays a run: its journal is not opened."""
    if "gsplat" in renderer and torch.cuda.is_available():
        pytest.skip("the backend is here")
    config, steps = load_config(overrides=[*SMALL, f"renderer.{renderer}"]), list[str]()
    with pytest.raises(CltransferError, match=line):
        prepare(
            Inputs(scene, "builtin:static"),
            config,
            Clock(),
            lambda step, *_: steps.append(step),
            Record(tmp_path / "j"),
        )
    assert steps == []
    assert not (tmp_path / "j").exists()


def test_a_clip_whose_times_no_result_could_keep_is_refused_before_the_search(
    mean_flow: tuple[str, ...], tmp_path: Path
) -> None:
    wall = torch.randint(0, 256, (3, 3, 36, 64), generator=torch.Generator().manual_seed(0), dtype=torch.uint8)
    write_video(tmp_path / "a.mkv", wall, torch.tensor([0.0, 1.0, 2e6], dtype=torch.float64), lossless=True)
    config, journal = load_config(overrides=["preset=fast", *SMALL[2:], *mean_flow]), tmp_path / "journal"
    with pytest.raises(InputError, match=r"a.mkv: t: expected at most 1e\+06 s .*, got 2e\+06 s \(take a part, .*#t="):
        prepare(Inputs("builtin:plaza", str(tmp_path / "a.mkv")), config, Clock(), lambda *_: None, Record(journal))
    assert not journal.exists()


@pytest.mark.parametrize(("name", "field"), [("path.json", "time"), ("a.safetensors", "times")])
def test_times_that_no_result_could_keep_are_named_as_the_file_calls_them(
    name: str, field: str, tmp_path: Path
) -> None:
    file, times = tmp_path / name, torch.tensor([0.0, 2e6], dtype=torch.float64)
    Trajectory(sample_cameras(0, 2), times).save(tmp_path / "path.json")
    FeatureFile(replace(sample_features(0, 2), camera=None, person=None), times, "").save(tmp_path / "a.safetensors")
    source = f"builtin:plaza@{file}" if field == "time" else str(file)
    with pytest.raises(InputError, match=rf"{name}: {field}: expected at most 1e\+06 s from the first frame"):
        prepare(Inputs("builtin:plaza", source), load_config(overrides=[*SMALL]), Clock(), silent, None)


@pytest.mark.parametrize(
    ("overrides", "line"),
    [
        (["path=exact"], "zoom: still is for a path, expected path smooth, got exact"),
        (["path=smooth", "search={se3_jaws: {}}"], "zoom: search se3_jaws does not tell what its lens is"),
    ],
)
def test_a_lens_that_nothing_keeps_still_is_refused(overrides: list[str], line: str) -> None:
    config = load_config(overrides=[*SMALL, "zoom=still", *overrides])
    with pytest.raises(UsageError, match=line):
        prepare(Inputs("builtin:plaza", "builtin:static"), config, Clock(), lambda *_: None, None)


def test_a_scene_that_cannot_be_merged_is_refused_before_anything_is_read(tmp_path: Path) -> None:
    config = load_config(overrides=[*SMALL, "lod=2", "renderer.mesh={}"])
    steps, inputs = list[str](), Inputs("builtin:plaza-0-mesh", "builtin:static")
    with pytest.raises(UsageError, match="lod: expected Gaussian splats, got Mesh"):
        prepare(inputs, config, Clock(), lambda step, *_: steps.append(step), Record(tmp_path / "journal"))
    assert steps == []
    assert not (tmp_path / "journal").exists()


def test_a_result_that_cannot_be_read_back_is_refused_before_it_is_searched(tmp_path: Path) -> None:
    """Of a reference as large, of which only the joints are known."""
    seen = sample_features(0, 2)
    joints = seen.require("keypoints") * torch.tensor([64.0, 64.0, 1.0])
    FeatureFile(Features((4096, 2304), keypoints=joints), torch.arange(2).double(), "wide").save(
        tmp_path / "a.safetensors"
    )
    config = load_config(overrides=[*SMALL, "output_side=4096", "extract.verify=false"])
    with pytest.raises(ResourceError, match="frames: expected at most 8847360 pixels each, got 4096x2304"):
        prepare(Inputs("builtin:plaza", str(tmp_path / "a.safetensors")), config, Clock(), silent, None)
