"""A scene with a trajectory is told from a file, and its two names from each other, whatever @ they hold."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import pytest

from cltransfer.config import load_config
from cltransfer.pipeline.components import Components
from cltransfer.reading.named_scenes import load_reference_scene
from cltransfer.reading.reference import Reading, read_reference
from cltransfer.reading.scene_source import is_scene, split_scene
from cltransfer.shots import shot
from cltransfer.testing import sample_subject

THERE = ("scene.ply", "a@b/scene.ply", "a@b/man.glb", "a@b/shot.json", "a@b/clip.mp4", "my@take.json", "shot.json")
SPLIT = {
    "scene.ply@shot.json": ("scene.ply", "shot.json"),
    "scene.ply@a@b/shot.json": ("scene.ply", "a@b/shot.json"),
    "a@b/scene.ply@shot.json": ("a@b/scene.ply", "shot.json"),
    "a@b/scene.ply@a@b/shot.json": ("a@b/scene.ply", "a@b/shot.json"),
    "a@b/man.glb#t=0.6@a@b/shot.json": ("a@b/man.glb#t=0.6", "a@b/shot.json"),
    "scene.ply@my@take.json": ("scene.ply", "my@take.json"),
    "builtin:plaza@a@b/shot.json": ("builtin:plaza", "a@b/shot.json"),
    "builtin:plaza@a@b/none.json": ("builtin:plaza", "a@b/none.json"),
    "a@b/scene.ply@a@b/none.json": ("a@b/scene.ply", "a@b/none.json"),
    "none.ply@shot.json": ("none.ply", "shot.json"),
    "no@ne.ply@none.json": ("no@ne.ply", "none.json"),
    "@none.ply@none.json": ("@none.ply", "none.json"),
    "#@none.ply@none.json": ("#@none.ply", "none.json"),
}
WHOLE = (
    "@shot.json",
    "my@take.json",
    "a@b/shot.json",
    "a@b/clip.mp4",
    "a@b/clip.mp4#t=0,1",
    "a@b/none.mp4",
    "none.json",
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in THERE:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    return tmp_path


@pytest.mark.parametrize("source", SPLIT)
def test_the_two_names_are_told_from_each_other(folder: Path, source: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert split_scene(source, folder) == SPLIT[source]
    monkeypatch.chdir(folder)
    assert split_scene(source) == SPLIT[source]
    assert is_scene(source)


@pytest.mark.parametrize("source", WHOLE)
def test_a_file_is_no_scene_with_a_trajectory(folder: Path, source: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert split_scene(source, folder) is None
    monkeypatch.chdir(folder)
    assert not is_scene(source)


@pytest.mark.parametrize("name", ["@", "scene.ply@", "no@"])
def test_a_name_of_many_marks_takes_no_memory(folder: Path, name: str) -> None:
    source = f"{name * 10_000}.json"
    tracemalloc.start()
    found = split_scene(source, folder)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found == tuple(source.rsplit("@", 1))
    assert peak < 200 * len(source)


def test_a_reference_is_read_from_a_folder_with_an_at(tmp_path: Path) -> None:
    path = tmp_path / "a@b" / "shot.json"
    shot("pan", sample_subject(), (160, 90), 3).save(path)
    scene, cameras = load_reference_scene(f"builtin:plaza@{path}", None, 160)
    assert (scene.subject is not None, len(cameras)) == (True, 3)
    reading = Reading(2, 48)
    read = read_reference(f"builtin:plaza@{path}", Components.build(load_config()), reading)
    assert (read.name, len(read)) == ("shot", 2)
