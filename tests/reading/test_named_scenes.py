"""What this computer remembers of scenes helps later, and costs nothing that is finished."""

from __future__ import annotations

import json
import shlex
from dataclasses import replace
from pathlib import Path

import pytest
import torch
import typer

from cltransfer.cli.app import app
from cltransfer.config import load_config
from cltransfer.errors import InputError
from cltransfer.pipeline.components import Components
from cltransfer.reading.named_scenes import lift_command, load_reference_scene, recall, remember
from cltransfer.reading.reference import Reading, read_reference
from cltransfer.scenes.load import load_scene
from cltransfer.scenes.person.lifted import save_labels
from cltransfer.scenes.ply import write_splats
from cltransfer.scenes.splats import Splats
from cltransfer.shots import shot
from cltransfer.storage.run_files import MANIFEST, SUBJECT
from cltransfer.trajectory import Trajectory


def test_a_scene_is_recalled_by_its_content(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path / "cache"))
    remember("ab12", str(tmp_path / "scene.ply"))
    assert recall("ab12") == str(tmp_path / "scene.ply")
    with pytest.raises(InputError, match="has not seen the scene"):
        recall("ab13")
    for damaged in ("{}", "[]", '{"path": 3}'):
        (tmp_path / "cache" / "scenes" / "ab13.json").write_text(damaged)
        with pytest.raises(InputError, match="has not seen the scene"):
            recall("ab13")


def test_a_cache_that_cannot_be_written_is_told_and_loses_no_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "cache").write_text("a file where the folder should be")
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path / "cache"))
    remember("ab12", "builtin:courtyard")
    remember("ab13", "builtin:$(yard)")
    line, strange = caplog.messages
    assert "ab12.json" in line
    assert "a later render needs --scene builtin:courtyard" in line
    assert "a later render needs --scene 'builtin:$(yard)'" in strange


@pytest.mark.parametrize(("frames", "count"), [(None, 24), (6, 6)])
def test_a_built_in_shot_is_made_of_so_many_frames_and_is_not_thinned(frames: int | None, count: int) -> None:
    _, path = load_reference_scene("builtin:push_in", frames, 160)
    assert path.times.tolist() == pytest.approx([i / 12 for i in range(count)])


def test_a_path_is_thinned_by_its_times_as_a_clip_is(tmp_path: Path) -> None:
    """Eight frames of a third of a second, then two of a second each: as a run leaves of a clip that was thinned."""
    plaza = load_scene("builtin:plaza")
    cameras = shot("push_in", plaza.subject, (160, 90), 10).camera
    times = torch.tensor([*(0.04 * k for k in range(8)), 1.0, 2.0], dtype=torch.float64)
    Trajectory(cameras, times).save(tmp_path / "trajectory.json")
    _, thinned = load_reference_scene(f"builtin:plaza@{tmp_path / 'trajectory.json'}", 3, 160)
    assert thinned.times.tolist() == pytest.approx([0.0, 1.0, 2.0])
    torch.testing.assert_close(thinned.camera.w2c, cameras[[0, 8, 9]].w2c)


def test_a_path_whose_pixels_are_not_square_is_taken_in_a_frame_of_square_ones(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    plaza, path = load_scene("builtin:plaza"), tmp_path / "trajectory.json"
    assert plaza.subject is not None
    wide = shot("static", plaza.subject, (320, 90), 2)
    squeezed = wide.camera.at_size((160, 90))
    Trajectory(squeezed, wide.times).save(path)
    _, taken = load_reference_scene(f"builtin:plaza@{path}", None, 320)
    assert taken.camera.size == (320, 90)
    torch.testing.assert_close(taken.camera.K, wide.camera.K)
    fx, fy = squeezed.K[0, [0, 1], [0, 1]].tolist()
    got = f"expected fx as fy, got {fx:.6g} and {fy:.6g}; its frame is taken as 320x90, of square pixels"
    assert caplog.messages == [f"{path}: focal length: {got}"]


def test_a_path_whose_principal_point_is_aside_anywhere_is_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    plaza, path = load_scene("builtin:plaza"), tmp_path / "trajectory.json"
    assert plaza.subject is not None
    straight = shot("static", plaza.subject, (160, 90), 3)
    straight.save(path)
    load_reference_scene(f"builtin:plaza@{path}", None, 160)
    assert caplog.messages == []
    K = straight.camera.K.clone()
    K[1, 0, 2] -= 40
    Trajectory(replace(straight.camera, K=K), straight.times).save(path)
    _, taken = load_reference_scene(f"builtin:plaza@{path}", None, 160)
    torch.testing.assert_close(taken.camera.K, K)
    got = "expected it in the middle, got -25.0% of the width and +0.0% of the height beside; every search has it there"
    assert caplog.messages == [f"{path}: principal point: {got}"]


def test_a_scene_that_teaches_without_a_person_names_the_lift_that_helps(tmp_path: Path) -> None:
    plaza, path = load_scene("builtin:plaza"), tmp_path / "takes of one" / "trajectory.json"
    assert isinstance(plaza.geometry, Splats)
    assert plaza.subject is not None
    shot("static", plaza.subject, (160, 90), 2).save(path)
    write_splats(tmp_path / "a scene.ply", plaza.geometry)
    source, parts = f"{tmp_path / 'a scene.ply'}@{path}", Components.build(load_config())
    with pytest.raises(InputError, match=r"no lifted person: no subject\.json beside the trajectory") as told:
        read_reference(source, parts, Reading(None, 48))
    _, verb, *words = shlex.split(told.value.hint.removeprefix("run: "))
    given = typer.main.get_command(app).commands[verb].make_context(verb, words).params  # type: ignore[attr-defined]
    assert (given["scene"], given["overrides"]) == (str(tmp_path / "a scene.ply"), ())
    plaza.subject.save(given["out"] / SUBJECT)  # what a lift leaves there
    save_labels(given["out"], plaza.geometry.label)
    assert len(read_reference(source, parts, Reading(None, 48))) == 2


def test_a_lift_is_led_out_of_a_run_and_drawn_as_its_scene_can_be(tmp_path: Path) -> None:
    source, mesh = f"man.glb@{tmp_path / 'trajectory.json'}", load_scene("builtin:room-3-mesh")
    lift = "cltransfer lift man.glb renderer.mesh={} --out"
    assert lift_command(source, mesh) == f"run: {lift} {tmp_path}"
    (tmp_path / MANIFEST).write_text(json.dumps({"format": "cltransfer.run"}))
    copied = f"copy {tmp_path / 'trajectory.json'} into a FOLDER of its own, and run: {lift} FOLDER"
    assert lift_command(source, mesh) == copied
