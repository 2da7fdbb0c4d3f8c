"""What a run leaves: the command in its report makes the run again."""

from __future__ import annotations

import json
import os
import shlex
from dataclasses import replace
from pathlib import Path

import pytest

from cltransfer.config import load_config
from cltransfer.errors import InputError, UsageError
from cltransfer.registry.plugin_code import own_code
from cltransfer.run.export import export_path
from cltransfer.run.folder import command_again, default_folder, report_data, summary_lines, write_run
from cltransfer.run.inputs import Inputs
from cltransfer.storage.run_files import CAMERA_PATH, CONFIG, DONE, MANIFEST, VIDEO
from cltransfer.transfer import transfer


def test_the_command_of_a_run_can_be_pasted_though_names_have_spaces() -> None:
    line = command_again(Path("my run"), Inputs("my scene.ply", "a clip.mp4"), ["my plugin.py"])
    assert shlex.split(line)[2:4] == ["my scene.ply", "a clip.mp4"]


def test_a_run_of_a_scene_that_is_named_by_where_it_lies_lies_in_outputs_too() -> None:
    for scene, reference in (("..", "."), ("../..", "./")):
        assert default_folder(scene, reference).parts[:-1] == ("outputs", "run", "run")
    folder = default_folder("builtin:plaza", "clips/walk.mp4#t=1,2")
    assert folder.parts[:-1] == ("outputs", "plaza", "walk")


def test_a_manifest_tells_by_what_a_run_was_made_and_a_last_line_what_goes_on_from_there(tmp_path: Path) -> None:
    inputs = Inputs("builtin:plaza", "builtin:static")
    config = load_config(overrides=["preset=fast", "frames=1", "search_side=32", "output_side=48", "path=exact"])
    result = transfer(inputs, config)
    headed = replace(result, header={**result.header, "network of pose": "0a"})
    report = write_run(tmp_path / "run", headed, inputs, config)
    told = json.loads((tmp_path / "run" / MANIFEST).read_text())
    assert (told["network of pose"], told["code of cltransfer"]) == ("0a", own_code())
    assert (told["person"], told["init"]) == (result.scene.person_digest, "auto")
    assert not [key for key in told if key.startswith("config.")]  # config.yaml holds those
    commands = [line.partition("cltransfer ")[2] for line in summary_lines(tmp_path / "run", report).splitlines()[-2:]]
    run = shlex.quote(os.path.relpath(tmp_path / "run"))
    assert commands == [f"render {run} --fps 24 --out film.mp4", f"export {run} --out shot.py"]


def test_of_several_rounds_the_one_that_is_kept_is_counted_from_one() -> None:
    inputs = Inputs("builtin:plaza", "builtin:push_in")
    tiny = ["preset=fast", "frames=2", "search_side=32", "output_side=48", "path=exact"]
    result = transfer(inputs, load_config(overrides=tiny))
    total = str(round(result.verified.total, 4))
    for best in (0, 1):
        twice = replace(result, attempts=2 * result.attempts, best=best)
        told = report_data(Path("out"), twice, inputs, ()).spent["total by round"]
        assert told == f"{total}, {total} (kept {best + 1})"
    assert report_data(Path("out"), result, inputs, ()).spent["total by round"] == total


def test_nothing_is_written_over_what_is_no_run_nor_through_a_link_out_of_one(tmp_path: Path) -> None:
    inputs = Inputs("builtin:plaza", "builtin:static")
    config = load_config(overrides=["preset=fast", "frames=1", "search_side=32", "output_side=48", "path=exact"])
    result, app, run = transfer(inputs, config), tmp_path / "app", tmp_path / "run"
    for folder in (app, tmp_path / "films", run):
        folder.mkdir()
    for name in (MANIFEST, CONFIG):
        (app / name).write_text('{"name": "an app"}')
    (tmp_path / "films" / VIDEO.name).write_bytes(b"mine")
    (run / VIDEO.parent).symlink_to(tmp_path / "films")
    before = {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}
    with pytest.raises(UsageError, match="app: --out: is neither empty nor a run"):
        write_run(app, result, inputs, config)
    with pytest.raises(InputError, match="leads out of the folder of its run"):
        write_run(run, result, inputs, config)
    assert {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()} == before
    for _ in range(2):
        write_run(tmp_path / "new", result, inputs, config)
    assert (tmp_path / "new" / DONE).is_file()


def test_the_camera_that_a_run_leaves_for_nerfstudio_is_the_one_that_it_exports(tmp_path: Path) -> None:
    inputs = Inputs("builtin:plaza", "builtin:static")
    config = load_config(overrides=["preset=fast", "frames=1", "search_side=32", "output_side=49", "path=exact"])
    write_run(tmp_path / "run", transfer(inputs, config), inputs, config)
    assert export_path(tmp_path / "run", tmp_path / "shot.json", None, None).camera.size == (50, 28)
    assert (tmp_path / "run" / CAMERA_PATH).read_bytes() == (tmp_path / "shot.json").read_bytes()


def test_the_command_of_a_run_names_what_it_was_given() -> None:
    inputs = Inputs("a.ply", "b.mp4", "views:3", Path("me/subject.json"), (0.0, -1.0, 0.5))
    words = shlex.split(command_again(Path("out"), inputs, ["one.py", "two.py"]))
    assert words[4:10] == ["--init", "views:3", "--subject", "me/subject.json", "--up", "0.0,-1.0,0.5"]
    assert words[10:14] == ["--allow-plugin", "one.py", "--allow-plugin", "two.py"]
