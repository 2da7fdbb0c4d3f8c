"""The path of a run, or a trajectory alone, as a camera of other programs."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from cltransfer.camera import intrinsics, resized
from cltransfer.clips.clip import write_video
from cltransfer.clips.decoding import decode
from cltransfer.errors import InputError, UsageError
from cltransfer.run.export import export_path
from cltransfer.run.frame_rate import at_rate
from cltransfer.storage.run_files import CAMERA_PATH, DONE, MANIFEST, STRIP, TRAJECTORY
from cltransfer.testing.samples import sample_cameras
from cltransfer.trajectory import Trajectory

NAMES = {"shot.usda": "#usda 1.0\n", "shot.py": "# A camera path of cltransfer.", "shot.json": "{", "colmap": ""}


@pytest.mark.parametrize("name", NAMES)
def test_the_ending_says_for_which_program(tiny_run: Path, tmp_path: Path, name: str) -> None:
    written = export_path(tiny_run, tmp_path / "new" / name, None, None)
    assert (written.times == Trajectory.load(tiny_run / TRAJECTORY).times).all()
    made = tmp_path / "new" / name
    if made.suffix:
        assert made.read_text().startswith(NAMES[name])
    else:
        assert sorted(file.name for file in made.iterdir()) == ["cameras.txt", "images.txt", "points3D.txt"]
    alone = tmp_path / "alone" / name
    export_path(tiny_run / TRAJECTORY, alone, None, None)  # a built-in scene is no file that is turned
    files = [made] if made.suffix else sorted(made.iterdir())
    assert all(file.read_bytes() == (alone.parent / file.relative_to(made.parent)).read_bytes() for file in files)


def test_what_a_run_writes_for_nerfstudio_itself_is_the_same(tiny_run: Path, tmp_path: Path) -> None:
    export_path(tiny_run, tmp_path / "shot.json", None, None)
    assert (tmp_path / "shot.json").read_bytes() == (tiny_run / CAMERA_PATH).read_bytes()


def test_a_picture_is_as_large_as_is_asked_for_and_a_films_always_even(
    command: Callable[..., Any], tiny_run: Path, tmp_path: Path
) -> None:
    own = Trajectory.load(tiny_run / TRAJECTORY)
    Trajectory(resized(own.camera, (720, 405)), own.times).save(tmp_path / "odd.json")
    for source, asked, size in (("odd.json", [], (720, 406)), (tiny_run, ["output_side=1920"], (1920, 1080))):
        said = command("export", tmp_path / source, *asked, "--out", tmp_path / "shot.py")
        assert (said.code, said.err) == (0, "")
        assert f" cameras of {size[0]}x{size[1]} over " in said.out
        assert f"\nSIZE = {size}  # [px]\n" in (tmp_path / "shot.py").read_text()
    refused = {
        "search_side=96": "search_side: changes nothing of a camera, expected a key that it looks at (output_side)",
        "output_side=8": "output_side: expected 16 to 4096, got 8",
    }
    for override, line in refused.items():
        said = command("export", tiny_run, override, "--out", tmp_path / "shot.py")
        assert (said.code, line in said.err) == (2, True), said.err


def test_a_picture_fits_the_videos_of_the_run(tiny_run: Path, tmp_path: Path) -> None:
    """In the video the odd row is there twice; images of a model are the lossless frames; nerfstudio knows no shift."""
    own = Trajectory.load(tiny_run / TRAJECTORY)
    odd = Trajectory(resized(own.camera, (48, 27)), own.times)
    odd.save(tmp_path / "odd.json")
    frames = torch.zeros(len(own), 3, 27, 48, dtype=torch.uint8)
    for name, lossless in (("shot.mp4", False), ("frames.mkv", True)):
        write_video(tmp_path / name, frames, own.times, lossless)
    for out, video in (("shot.py", "shot.mp4"), ("shot.usda", "shot.mp4"), ("colmap", "frames.mkv")):
        written = export_path(tmp_path / "odd.json", tmp_path / out, None, None).camera
        assert written.size == next(decode(tmp_path / video)).size
        assert torch.equal(written.K, odd.camera.K)
    assert "PINHOLE 48 27 " in (tmp_path / "colmap" / "cameras.txt").read_text()
    centred = export_path(tmp_path / "odd.json", tmp_path / "shot.json", None, None).camera
    torch.testing.assert_close(centred.K, intrinsics(odd.camera.focal, (48, 28)))


def test_frames_between_those_of_the_run(tiny_run: Path, tmp_path: Path) -> None:
    own = Trajectory.load(tiny_run / TRAJECTORY)
    written = export_path(tiny_run, tmp_path / "shot.usda", 48, None)
    assert len(written) == int(float(own.times[-1] - own.times[0]) * 48 + 1e-6) + 1 > len(own)
    assert "    timeCodesPerSecond = 48\n" in (tmp_path / "shot.usda").read_text()


@pytest.mark.parametrize(("file", "axis"), [(".glb", "Y"), (".obj", "Y"), (".ply", "Z"), ("", "Z")])
def test_the_scene_of_the_run_says_whether_programs_turn_it(
    tiny_run: Path, tmp_path: Path, file: str, axis: str
) -> None:
    run = shutil.copytree(tiny_run, tmp_path / "run")
    manifest = json.loads((run / MANIFEST).read_text())
    assert manifest["scene"]["file"] == ""  # a built-in one
    manifest["scene"]["file"] = file
    (run / MANIFEST).write_text(json.dumps(manifest))
    for y_up, told in ((None, axis), (True, "Y"), (False, "Z")):
        export_path(run, tmp_path / "shot.usda", None, y_up)
        assert f'upAxis = "{told}"' in (tmp_path / "shot.usda").read_text()


def test_where_the_run_does_not_tell_it_has_to_be_said(tiny_run: Path, tmp_path: Path) -> None:
    run = shutil.copytree(tiny_run, tmp_path / "run")
    manifest = json.loads((run / MANIFEST).read_text())
    composed = {**manifest["scene"], "file": ".yaml"}
    older = {name: value for name, value in composed.items() if name != "file"}
    for scene in (composed, older, {**composed, "file": None}):  # which Python has given
        (run / MANIFEST).write_text(json.dumps({**manifest, "scene": scene}))
        with pytest.raises(InputError, match=r"turn the scene's files.* \(say --y-up or --no-y-up\)"):
            export_path(run, tmp_path / "shot.usda", None, None)
        export_path(run, tmp_path / "shot.usda", None, True)
        export_path(run, tmp_path / "shot.json", None, None)  # which has no up


def test_what_changes_nothing_is_refused(tiny_run: Path, tmp_path: Path) -> None:
    for name in ("shot.json", "colmap"):
        with pytest.raises(UsageError, match="--y-up: changes nothing of this format"):
            export_path(tiny_run, tmp_path / name, None, False)


def test_the_rate_that_is_asked_for_numbers_the_frames(tiny_run: Path, tmp_path: Path) -> None:
    first = Trajectory.load(tiny_run / TRAJECTORY)
    Trajectory(first.camera[0], first.times[:1]).save(tmp_path / "one.json")
    for source, fps in ((tiny_run, 8.0), (tmp_path / "one.json", 48.0)):
        export_path(source, tmp_path / "shot.USDA", fps, None)
        assert f"    timeCodesPerSecond = {fps:g}\n" in (tmp_path / "shot.USDA").read_text()
        written = export_path(source, tmp_path / "shot.json", fps, None)
        told = json.loads((tmp_path / "shot.json").read_text())
        assert (told["fps"], told["seconds"], told["default_transition_sec"]) == (fps, len(written) / fps, 1 / fps)


def test_a_folder_that_is_there_may_have_any_name(tiny_run: Path, tmp_path: Path) -> None:
    (tmp_path / "v1.2").mkdir()
    export_path(tiny_run, tmp_path / "v1.2", None, None)
    assert (tmp_path / "v1.2" / "images.txt").is_file()


def test_what_the_run_is_called_does_not_reach_the_script(tiny_run: Path, tmp_path: Path) -> None:
    run = shutil.copytree(tiny_run, tmp_path / "'''); import os #")
    manifest = json.loads((run / MANIFEST).read_text())
    manifest["scene"]["name"] = "'''\nimport os"
    (run / MANIFEST).write_text(json.dumps(manifest))
    for source, name in ((tiny_run, "one.py"), (run, "two.py")):
        export_path(source, tmp_path / name, None, None)
    assert (tmp_path / "one.py").read_bytes() == (tmp_path / "two.py").read_bytes()


def test_files_of_the_run_itself_stay(tiny_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = shutil.copytree(tiny_run, tmp_path / "run")
    before = {file: file.read_bytes() for file in run.rglob("*") if file.is_file()}
    (tmp_path / "link.json").symlink_to(run / TRAJECTORY)
    for source in (run, run / TRAJECTORY):
        for out in (run / TRAJECTORY, run / CAMERA_PATH, run / "metrics.json", tmp_path / "link.json"):
            with pytest.raises(UsageError, match="is a file of a run itself, or what is read"):
                export_path(source, out, None, None)
    with pytest.raises(UsageError, match="video: --out: is a file of a run itself"):
        export_path(run, run / "video", None, None)  # a COLMAP model among its films
    (tmp_path / "cam").symlink_to(run / "camera")
    monkeypatch.chdir(run / "camera")
    for out in (Path(CAMERA_PATH.name), tmp_path / "cam" / CAMERA_PATH.name):
        with pytest.raises(UsageError, match="is a file of a run itself"):
            export_path(tiny_run, out, None, None)
    assert {file: file.read_bytes() for file in run.rglob("*") if file.is_file()} == before
    export_path(run, run / "camera" / "shot.usda", None, None)


def test_a_result_of_the_run_that_is_a_link_to_itself_is_no_place_of_a_model(tiny_run: Path, tmp_path: Path) -> None:
    run = shutil.copytree(tiny_run, tmp_path / "run")
    (run / STRIP).unlink()
    (run / STRIP).symlink_to(STRIP)
    assert len(export_path(run, tmp_path / "model", None, None)) == len(Trajectory.load(run / TRAJECTORY))


@pytest.mark.parametrize("name", ["loss.py", "stage.usda", "camera_path.json", "SHOT.PY"])
def test_what_somebody_else_has_written_stays(tiny_run: Path, tmp_path: Path, name: str) -> None:
    path = {"camera_type": "perspective", "camera_path": [{"camera_to_world": [1.0] * 16, "fov": 50.0, "aspect": 1.0}]}
    mine = {"loss.py": "from cltransfer import LOSSES\n", "stage.usda": "#usda 1.0\n", "SHOT.PY": "# A camera path.\n"}
    before = mine.get(name, json.dumps(path, indent=2))
    (tmp_path / name).write_text(before)
    with pytest.raises(UsageError, match=f"{name}: --out: is there, and was not exported here .name another, or take"):
        export_path(tiny_run, tmp_path / name, None, None)
    assert (tmp_path / name).read_text() == before


@pytest.mark.parametrize("name", NAMES)
def test_an_earlier_export_is_replaced_and_so_is_an_empty_file(tiny_run: Path, tmp_path: Path, name: str) -> None:
    if NAMES[name]:
        (tmp_path / name).touch()
    made = tmp_path / name / "images.txt" if name == "colmap" else tmp_path / name
    export_path(tiny_run, tmp_path / name, None, None)
    before = made.read_text()
    export_path(tiny_run, tmp_path / name, 48, None)
    assert len(made.read_text()) > len(before)


@pytest.mark.parametrize(
    ("name", "fps", "says"),
    [
        ("shot.fbx", None, r"expected a name that ends in .usda, .py \(Blender\) or .json"),
        ("here.usda", None, "expected a file, there is something else"),
        ("-", None, "expected the name of a file or folder"),
        ("shot.py", 0.0, r"--fps: expected a rate in \(0, 240\], got 0"),
        ("shot.py", 241.0, "expected a rate"),
    ],
)
def test_what_cannot_be_meant(tiny_run: Path, tmp_path: Path, name: str, fps: float | None, says: str) -> None:
    os.mkfifo(tmp_path / "here.usda")
    with pytest.raises(UsageError, match=says):
        export_path(tiny_run, Path(name) if name == "-" else tmp_path / name, fps, None)


def test_what_is_no_path(tiny_run: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    unfinished = shutil.copytree(tiny_run, tmp_path / "run")
    (unfinished / DONE).unlink()
    for source, says in (
        (tmp_path / "empty", "manifest.json: no such file"),
        (tmp_path / "gone.json", "no such file"),
        (tiny_run / "metrics.json", "format: expected 'cltransfer.trajectory'"),
        (unfinished, "this run was not finished"),
    ):
        with pytest.raises(InputError, match=says):
            export_path(source, tmp_path / "shot.py", None, None)


def test_the_verb_tells_what_it_wrote(command: Callable[..., Any], tiny_run: Path, tmp_path: Path) -> None:
    said = command("export", tiny_run, "--fps", 24, "--out", tmp_path / "shot.py")
    assert (said.code, said.err) == (0, "")
    assert said.out.startswith(f"{tmp_path / 'shot.py'}: ")
    assert said.out.endswith(" s, numbered at 24 frames/s\n")
    assert command("export", tiny_run).code == 2
    for y_up, axis in (("--y-up", "Y"), ("--no-y-up", "Z")):
        assert command("export", tiny_run, y_up, "--out", tmp_path / "shot.usda").code == 0
        assert f'upAxis = "{axis}"' in (tmp_path / "shot.usda").read_text()


@pytest.mark.parametrize(
    ("rate", "fps"), [(24000 / 1001, 23.976), (30000 / 1001, 29.97), (60000 / 1001, 59.94), (24, 24), (30, 30)]
)
def test_a_rate_that_is_nearly_that_of_the_path_keeps_its_last_frame(rate: float, fps: float) -> None:
    for count in (2, 3, 24, 97, 1000):
        times = (torch.arange(count).double() / rate * 1000).round() / 1000  # as files keep them
        path = Trajectory(sample_cameras(0, 1)[[0] * count], times)
        found = at_rate(path, fps).times
        assert len(found) == count
        assert (found.diff() > 0.9 / rate).all()
        assert found[-1] <= times[-1]
    half = Trajectory(sample_cameras(0, 2), torch.tensor([0.0, 1.5 / 24]).double())
    assert at_rate(half, 24).times.tolist() == [0, 1 / 24]


def test_a_camera_has_more_frames_than_a_video_keeps(tmp_path: Path) -> None:
    minute = Trajectory(sample_cameras(0, 2), torch.tensor([0.0, 60.0]))
    minute.save(tmp_path / "minute.json")
    assert len(export_path(tmp_path / "minute.json", tmp_path / "shot.usda", 48, None)) == 2881
    with pytest.raises(UsageError, match=r"240 makes 14401 frames of 60\.0 s, at most 2000"):
        at_rate(minute, 240)
