"""A clip is read once; what was read in other frames than it has now is not taken for it."""

from __future__ import annotations

import resource
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from cltransfer.clips import decoding
from cltransfer.clips.clip import write_video
from cltransfer.config import load_config
from cltransfer.errors import InputError, ResourceError
from cltransfer.features import Features, OfThisRun
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.graph import Load
from cltransfer.reading import reference
from cltransfer.reading.feature_file import FeatureFile
from cltransfer.reading.reference import Reading, Reference, as_read, read_reference
from cltransfer.storage.files import cache_dir
from cltransfer.testing import sample_cameras, sample_features
from cltransfer.trajectory import Trajectory

MIRROR = 2  # orientation of EXIF


def mirrored(folder: Path) -> Path:
    """A wall that moves down, in images that ask to be shown mirrored."""
    folder.mkdir()
    exif = Image.Exif()
    exif[0x0112] = MIRROR
    wall = np.random.default_rng(0).integers(0, 255, (36, 64, 3), np.uint8)
    for i in range(3):
        Image.fromarray(np.roll(wall, 2 * i, 0)).save(folder / f"{i}.png", exif=exif)
    return folder


@pytest.fixture
def readings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Features]:
    """What was read of frames so far, with a cache of the test's own."""
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path / "cache"))
    read, done = reference.read_frames, list[Features]()

    def counted(*given):
        features, flags = read(*given)
        done.append(features)
        return features, flags

    monkeypatch.setattr(reference, "read_frames", counted)
    return done


def test_a_reading_of_frames_that_are_decoded_otherwise_now_is_not_used(
    mean_flow: tuple[str, ...], readings: list[Features], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, parts = str(mirrored(tmp_path / "frames")), Components.build(load_config(overrides=mean_flow))
    with monkeypatch.context() as before:
        before.setattr(decoding, "_MIRRORED", ())  # as they were decoded once
        then = read_reference(source, parts, Reading()).features.require("flow")
    now = read_reference(source, parts, Reading()).features.require("flow")
    assert float((then[1:, 1] * now[1:, 1]).median()) < 0  # the other way
    torch.testing.assert_close(read_reference(source, parts, Reading()).features.require("flow"), now, equal_nan=True)
    assert len(readings) == 2  # the third time nothing was read
    assert len(list((cache_dir() / "features").iterdir())) == 2


def test_a_run_is_read_at_the_times_of_its_trajectory_and_anew_at_others(
    mean_flow: tuple[str, ...], readings: list[Features], tmp_path: Path
) -> None:
    run, parts = tmp_path / "run", Components.build(load_config(overrides=mean_flow))
    wall = torch.randint(0, 256, (3, 3, 36, 64), generator=torch.Generator().manual_seed(0), dtype=torch.uint8)
    write_video(run / "video" / "frames.mkv", wall, torch.arange(3).double(), lossless=True)
    (run / "manifest.json").write_text('{"format": "cltransfer.run"}')
    (run / "DONE").touch()
    for step in (1e-4, 2e-4, 2e-4):
        times = step * torch.arange(3).double()
        Trajectory(sample_cameras(0, 3), times).save(run / "trajectory.json")
        assert torch.equal(read_reference(str(run), parts, Reading()).times, times)
    assert len(readings) == 2  # the third time nothing was read


def test_a_cache_that_cannot_be_written_loses_no_reading(
    mean_flow: tuple[str, ...],
    readings: list[Features],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path / "file"))
    source, parts = str(mirrored(tmp_path / "frames")), Components.build(load_config(overrides=mean_flow))
    assert read_reference(source, parts, Reading()).features is readings[0]
    (line,) = caplog.messages
    assert line.endswith("Not a directory: the next run reads the clip anew")


def test_a_reading_that_was_kept_and_is_damaged_is_made_anew(
    mean_flow: tuple[str, ...], readings: list[Features], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    source, parts = str(mirrored(tmp_path / "frames")), Components.build(load_config(overrides=mean_flow))
    read_reference(source, parts, Reading())
    (kept,) = (cache_dir() / "features").iterdir()
    kept.write_bytes(kept.read_bytes()[:-9])
    for _ in range(2):
        read_reference(source, parts, Reading())
    assert len(readings) == 2  # the third time nothing was read
    (line,) = caplog.messages
    assert line.startswith(f"{kept}: ")
    assert line.endswith(": the clip is read anew")


def test_a_full_disk_loses_no_reading(
    mean_flow: tuple[str, ...], readings: list[Features], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    source, parts = str(mirrored(tmp_path / "frames")), Components.build(load_config(overrides=mean_flow))
    usual = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, usual[1]))  # [bytes] of any file: the rest of it fails
    try:
        got = read_reference(source, parts, Reading())
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)
    assert got.features is readings[0]
    (line,) = caplog.messages
    assert line.endswith(": the next run reads the clip anew")
    assert list((cache_dir() / "features").iterdir()) == []


@pytest.mark.parametrize(("reason", "times"), [("it stands still", 1), (OfThisRun("time ran out"), 2)])
def test_what_another_run_may_tell_is_not_kept(
    reason: str,
    times: int,
    mean_flow: tuple[str, ...],
    readings: list[Features],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def lacking(*given):
        features, flags = read(*given)
        return replace(features, reasons={"depth": reason}), flags

    read = reference.read_frames
    monkeypatch.setattr(reference, "read_frames", lacking)
    source, parts = str(mirrored(tmp_path / "frames")), Components.build(load_config(overrides=mean_flow))
    for _ in range(2):
        assert read_reference(source, parts, Reading()).features.reasons == {"depth": reason}
    assert len(readings) == times


def test_what_the_cache_cannot_hold_is_read_anew(
    mean_flow: tuple[str, ...], readings: list[Features], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def labelled(*given):
        features, flags = read(*given)
        return replace(features, label=torch.zeros(3, 36, 64)), flags

    read = reference.read_frames
    monkeypatch.setattr(reference, "read_frames", labelled)
    source, parts = str(mirrored(tmp_path / "frames")), Components.build(load_config(overrides=mean_flow))
    for _ in range(2):
        assert read_reference(source, parts, Reading()).features.has("label")
    assert len(readings) == 2


@dataclass(frozen=True)
class OfPixels:
    """A loss of what else is never kept: it is in the clip itself."""

    requires = ("image",)


def test_a_second_reading_has_the_pixels_that_a_loss_asks_for(
    mean_flow: tuple[str, ...], readings: list[Features], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    parts = Components.build(load_config(overrides=mean_flow))
    parts = replace(parts, losses={**parts.losses, "of_pixels": OfPixels()})
    source = str(mirrored(tmp_path / "frames"))
    first, second = (read_reference(source, parts, Reading()).features for _ in range(2))
    assert len(readings) == 1
    assert torch.equal(first.require("image"), second.require("image"))
    assert first.names() == second.names()
    monkeypatch.setattr("cltransfer.computer.memory.free_bytes", lambda: 24 * 3 * 64 * 36)  # the cached, not the maps
    with pytest.raises(ResourceError, match=r"the maps of frames, 3 of 64x36, need .* thin the clip by frames="):
        read_reference(source, parts, Reading())


def test_a_scene_that_teaches_is_asked_for_before_its_frames_are_rendered(monkeypatch: pytest.MonkeyPatch) -> None:
    parts = Components.build(load_config())
    monkeypatch.setattr("cltransfer.computer.memory.free_bytes", lambda: 10**6)
    with pytest.raises(ResourceError, match=r"the maps of frames, 3 of \d+x\d+, need"):
        read_reference("builtin:pan", parts, Reading(frames=3))


def test_the_feature_file_that_the_docs_write_is_a_reference(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "python.md").read_text(encoding="utf-8")
    snippet = page.partition("## Features\n")[2].partition("```python\n")[2].partition("```")[0]
    monkeypatch.chdir(tmp_path)
    seen = sample_features(0, 3)
    exec(snippet, {name: seen.require(name) for name in ("keypoints", "subject")})
    parts = Components.build(load_config())
    read = read_reference("features.safetensors", parts, Reading())
    assert read.features.names() == {"keypoints", "subject"}
    assert read.times.tolist() == [0, 1 / 24, 2 / 24]
    assert read.missing["flow"] == "not in the feature file"
    assert bool(parts.objective.defined(read.features)[:, 0].all())
    with pytest.raises(InputError, match=r"holds 3 frames, 2 asked for \(take all by frames=null, or write a file "):
        read_reference("features.safetensors", parts, Reading(frames=2))


def test_a_feature_file_is_asked_for_before_it_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    FeatureFile(sample_features(0, 3), torch.arange(3) / 24, "").save(tmp_path / "seen.safetensors")
    FeatureFile.load(tmp_path / "seen.safetensors")
    monkeypatch.setattr("cltransfer.computer.memory.free_bytes", lambda: 1000)
    with pytest.raises(ResourceError, match=r"seen\.safetensors: memory: the features need"):
        FeatureFile.load(tmp_path / "seen.safetensors")


def test_a_feature_file_whose_times_are_none_of_frames_is_no_reference(tmp_path: Path) -> None:
    path, parts = tmp_path / "seen.safetensors", Components.build(load_config())
    for last in (-1.7e308, 1e-7, 1e11):
        FeatureFile(sample_features(0, 2), torch.tensor([min(last, 0.0), abs(last)], dtype=torch.float64), "").save(
            path
        )
        with pytest.raises(InputError, match=r"seen\.safetensors: times: expected"):
            read_reference(str(path), parts, Reading())


@dataclass(frozen=True)
class FrameByFrame:
    """Reads a whole clip, and asks for every frame of it once more."""

    requires, provides, family, whole_clip = ("image",), ("mine",), "image", True

    def read_clip(self, found: Features, load: Load) -> Features:
        grey = [load(i, i + 1).require("image").mean() for i in range(len(found))]
        return found.having("mine", torch.stack(grey)[:, None])


@dataclass(frozen=True)
class OfMine:
    requires = ("mine",)


def test_a_scene_that_is_asked_for_a_frame_again_has_shown_it_once(mean_flow: tuple[str, ...]) -> None:
    parts = Components.build(load_config(overrides=mean_flow))
    more = {**parts.extractors, "frame_by_frame": FrameByFrame()}
    parts = replace(parts, losses={**parts.losses, "of_mine": OfMine()}, extractors=more)
    read = read_reference("builtin:push_in", parts, Reading(6, 48, "image"))
    assert read.image is not None
    assert len(read.image) == len(read) == 6
    torch.testing.assert_close(read.features.require("mine")[:, 0], read.image.float().div(255).flatten(1).mean(1))


def test_a_reading_by_other_code_of_ours_is_not_used(
    mean_flow: tuple[str, ...], readings: list[Features], tmp_path: Path, edited: Callable[[str], None]
) -> None:
    source, parts = str(mirrored(tmp_path / "frames")), Components.build(load_config(overrides=mean_flow))
    read_reference(source, parts, Reading())
    for count, module in enumerate(("clips/join_persons.py", "extractors/_dense_flow.py", "orientation.py"), start=2):
        edited(module)
        read_reference(source, parts, Reading())
        assert len(readings) == count
    edited("describe/description.py")  # reads no picture
    read_reference(source, parts, Reading())
    assert len(readings) == count


@pytest.mark.parametrize(
    ("family", "said", "meant"),
    [("image", "auto", "shown"), ("scene", "auto", "auto"), ("image", "body", "body"), ("scene", "shown", "shown")],
)
def test_an_angle_is_about_what_its_readers_saw_where_nobody_says(family: str, said: str, meant: str) -> None:
    parts = Components.build(load_config(overrides=[f"extractors.scene_orientation.about={said}"]))
    known = Reference(sample_features(0, 1), torch.zeros(1), None, "clip", "", family, {})
    assert as_read(parts, known).extractors["scene_orientation"].about == meant
