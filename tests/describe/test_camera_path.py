"""A camera path is told from a clip, a feature file and a scene with a path, by name and by what lies there."""

from __future__ import annotations

from pathlib import Path

from cltransfer.describe.camera_path import camera_path


def test_a_trajectory_and_a_folder_that_holds_one_are_camera_paths(tmp_path: Path) -> None:
    (tmp_path / "trajectory.json").touch()
    assert camera_path(str(tmp_path)) == tmp_path / "trajectory.json"
    assert camera_path(str(tmp_path / "shot.json")) == tmp_path / "shot.json"
    (tmp_path / "my@take.json").touch()
    assert camera_path(str(tmp_path / "my@take.json")) == tmp_path / "my@take.json"


def test_what_is_read_off_pictures_is_none(tmp_path: Path) -> None:
    (tmp_path / "scene.ply").touch()
    (tmp_path / "frames").mkdir()
    scene = f"{tmp_path / 'scene.ply'}@{tmp_path / 'shot.json'}"
    sources = [str(tmp_path / name) for name in ("clip.mp4", "features.safetensors", "frames")]
    assert [camera_path(source) for source in (*sources, scene, "builtin:pan")] == [None] * 5
