"""A run is rendered again into its own folder, and nowhere that a folder which only looks like a run leads to."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
import torch

from cltransfer.clips.clip import read_clip, write_video
from cltransfer.errors import InputError, UsageError
from cltransfer.progress import silent
from cltransfer.run.render import render_run
from cltransfer.storage.files import content_hash
from cltransfer.storage.run_files import BESIDE, CONFIG, JOURNAL, MANIFEST, VIDEO


def test_what_only_looks_like_a_run_is_not_written_into(tiny_run: Path, tmp_path: Path) -> None:
    run = shutil.copytree(tiny_run, tmp_path / "run")
    manifest = json.loads((run / MANIFEST).read_text())
    (run / MANIFEST).write_text(json.dumps({**manifest, "format": "another"}))
    (run / JOURNAL).unlink()
    shutil.move(run / VIDEO.parent, tmp_path / "elsewhere")
    (run / VIDEO.parent).symlink_to(tmp_path / "elsewhere")
    before = (tmp_path / "elsewhere" / VIDEO.name).stat().st_mtime_ns
    with pytest.raises(InputError, match=r"manifest.json: is no run's \(expected the folder of a run\)"):
        render_run(run, ["output_side=64"], None, None, None, silent)
    assert (tmp_path / "elsewhere" / VIDEO.name).stat().st_mtime_ns == before


def test_no_other_file_of_the_run_is_written_over_and_no_film_is_drawn_for_nothing(
    tiny_run: Path, tmp_path: Path
) -> None:
    steps, before = list[str](), (tiny_run / BESIDE).read_bytes()
    (tmp_path / "folder.mp4").mkdir()
    (tmp_path / "file").touch()
    for out, told in (
        (tiny_run / BESIDE, "is a file of a run itself"),
        (tmp_path / "folder.mp4", "expected a file, there is something else"),
        (tmp_path / "file" / "film.mp4", "cannot lie in .*file, which is a file"),
    ):
        with pytest.raises(UsageError, match=f"--out: {told}"):
            render_run(tiny_run, [], None, None, out, lambda step, *_: steps.append(step))
    assert steps == []
    assert (tiny_run / BESIDE).read_bytes() == before


def test_no_film_of_another_run_is_written_over(tiny_run: Path, tmp_path: Path) -> None:
    other = shutil.copytree(tiny_run, tmp_path / "other")
    (tmp_path / "link.mp4").symlink_to(other / VIDEO)
    before = (other / VIDEO).read_bytes()
    for out in (other / VIDEO, other / "." / BESIDE, tmp_path / "link.mp4"):
        with pytest.raises(UsageError, match="--out: is a file of a run itself"):
            render_run(tiny_run, [], None, None, out, silent)
    assert (other / VIDEO).read_bytes() == before


def test_what_was_not_rendered_here_stays(tiny_run: Path, tmp_path: Path) -> None:
    clip = tmp_path / "clip.mp4"
    write_video(clip, torch.zeros(2, 3, 36, 64, dtype=torch.uint8), torch.arange(2) / 24)
    shutil.copy(clip, tmp_path / "CLIP.MP4")
    (tmp_path / "notes.mp4").write_text("no film")
    for out in (clip, tmp_path / "CLIP.MP4", tmp_path / "notes.mp4"):
        before = out.read_bytes()
        with pytest.raises(UsageError, match=f"{out.name}: --out: is there, and was not rendered here .name another"):
            render_run(tiny_run, [], None, None, out, silent)
        assert out.read_bytes() == before


def test_an_earlier_film_is_replaced_and_so_is_an_empty_file_but_no_reference(tiny_run: Path, tmp_path: Path) -> None:
    run, film = shutil.copytree(tiny_run, tmp_path / "run"), tmp_path / "film.mp4"
    film.touch()
    for side in (64, 48):
        render_run(run, [f"output_side={side}"], None, None, film, silent)
        assert read_clip(film).size[0] == side
    manifest = json.loads((run / MANIFEST).read_text())
    manifest["reference"]["sha256"] = content_hash(film)
    (run / MANIFEST).write_text(json.dumps(manifest))
    before = film.read_bytes()
    with pytest.raises(UsageError, match=r"film.mp4: --out: is the reference of this run .name another"):
        render_run(run, [], None, None, film, silent)
    assert film.read_bytes() == before
    (run / MANIFEST).write_text(json.dumps({**manifest, "reference": None}))
    with pytest.raises(InputError, match=r"manifest.json: reference: expected sha256"):
        render_run(run, [], None, None, film, silent)


def test_the_config_of_a_run_opens_no_other_file(tiny_run: Path, tmp_path: Path) -> None:
    run = shutil.copytree(tiny_run, tmp_path / "run")
    (tmp_path / "accounts.yaml").write_text("password: x\n")
    (run / CONFIG).write_text("base: ../accounts.yaml\n")
    with pytest.raises(UsageError, match=r"config.yaml: base: expected a whole config, got one over another"):
        render_run(run, [], None, None, None, silent)


def test_a_built_in_scene_that_is_not_that_of_the_run_is_told_as_that(tiny_run: Path, tmp_path: Path) -> None:
    """Though what is up in a file that the run was made in is not up in it."""
    run = shutil.copytree(tiny_run, tmp_path / "run")
    manifest = json.loads((run / MANIFEST).read_text())
    manifest["scene"] |= {"sha256": "0" * 64, "up": [0.0, -1.0, 0.0]}
    (run / MANIFEST).write_text(json.dumps(manifest))
    with pytest.raises(InputError, match="builtin:room: sha256: is not the scene of this run"):
        render_run(run, [], None, "builtin:room", None, silent)


def test_a_run_of_a_scene_that_python_gave_is_told_where_it_is_run_again(tiny_run: Path, tmp_path: Path) -> None:
    run = shutil.copytree(tiny_run, tmp_path / "run")
    manifest = json.loads((run / MANIFEST).read_text())
    manifest["scene"] |= {"sha256": "0" * 64}
    python = r"its scene was given from Python: run it there with a larger output_side"
    for file, hint in ((".ply", "name it: --scene FILE or builtin:NAME"), (None, python)):
        manifest["scene"]["file"] = file
        (run / MANIFEST).write_text(json.dumps(manifest))
        with pytest.raises(InputError, match=rf"^scene: this computer has not seen the scene of this run \({hint}\)"):
            render_run(run, ["output_side=64"], None, None, None, silent)
