"""A run folder is one run: whole or refused, never two runs mixed, and nothing of it lies elsewhere."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from cltransfer.cli.shared import up_of
from cltransfer.driver.journal import Journal
from cltransfer.errors import InputError, UsageError
from cltransfer.run.folder import command_again, default_folder
from cltransfer.run.inputs import Inputs
from cltransfer.storage.run_files import (
    CONFIG,
    DONE,
    FRAMES,
    JOURNAL,
    MANIFEST,
    RESULTS,
    VIDEO,
    clear,
    is_run,
    kept_frames,
    open_run,
    refuse_run,
    refuse_written,
    require_done,
    require_run,
)


def killed(folder: Path) -> Path:
    """A folder in which one run was finished and the next one killed."""
    folder.mkdir()
    for name in (MANIFEST, "trajectory.json", JOURNAL):
        (folder / name).touch()
    return folder


def test_a_manifest_of_another_program_makes_no_run(tmp_path: Path) -> None:
    for text in ('{"name": "an app"}', "[]", "no JSON", ""):
        (tmp_path / MANIFEST).write_text(text)
        assert not is_run(tmp_path)
        with pytest.raises(UsageError, match="is neither empty nor a run"):
            open_run(tmp_path)
    (tmp_path / MANIFEST).write_text('{"format": "cltransfer.run"}')
    assert is_run(tmp_path)


def test_what_is_no_run_is_told_with_what_was_expected(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"manifest.json: no such file \(expected the folder of a run\)"):
        require_run(tmp_path)
    (tmp_path / MANIFEST).write_text("{}")
    with pytest.raises(InputError, match=r"manifest.json: is no run's \(expected a run, or a path\)"):
        require_run(tmp_path, "a run, or a path")
    (tmp_path / MANIFEST).write_text('{"format": "cltransfer.run"}')
    require_run(tmp_path)


def test_a_journal_of_another_program_makes_no_run(tmp_path: Path) -> None:
    (tmp_path / JOURNAL).write_text("Dear diary, today")
    assert not is_run(tmp_path)
    for resume, option in ((False, "--out"), (True, "--resume")):
        with pytest.raises(UsageError, match=f"{option}: is neither empty nor a run"):
            open_run(tmp_path, resume)
    Journal(tmp_path / JOURNAL, {"seed": 0}, False)
    assert is_run(tmp_path)
    (tmp_path / JOURNAL).write_bytes(b"")  # killed before the header was written
    assert is_run(tmp_path)


@pytest.mark.parametrize(("name", "hint"), [("run", "run/person"), ("$(run)", "'$(run)/person'")])
def test_a_folder_in_a_command_to_copy_is_quoted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, hint: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path(name).mkdir()
    (Path(name) / MANIFEST).write_text('{"format": "cltransfer.run"}')
    with pytest.raises(UsageError) as caught:
        refuse_run(Path(name), "subject", "person")
    assert str(caught.value).endswith(f"(as in --out {hint})")


def test_a_run_that_was_killed_is_no_result(tmp_path: Path) -> None:
    run = killed(tmp_path / "run")
    with pytest.raises(InputError, match=r"DONE: this run was not finished \(go on with it: .* --resume RUN\)"):
        require_done(run)
    (run / DONE).touch()
    require_done(run)
    require_done(tmp_path)  # no run at all: an image folder


def test_of_a_run_its_kept_frames_are_looked_at_and_any_other_clip_is_itself(tmp_path: Path) -> None:
    run = killed(tmp_path / "run")
    with pytest.raises(InputError, match="not finished"):
        kept_frames(run)
    (run / DONE).touch()
    assert kept_frames(run) == run / FRAMES
    assert kept_frames(tmp_path) == tmp_path
    assert kept_frames(tmp_path / "clip.mp4") == tmp_path / "clip.mp4"


def test_what_an_earlier_run_left_is_taken_away_and_nothing_else(tmp_path: Path) -> None:
    for name in (*RESULTS, "notes.txt"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    clear(tmp_path)
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["camera", MANIFEST, "notes.txt", "video"]


def test_what_was_being_written_when_a_run_was_killed_is_taken_away_too(tmp_path: Path) -> None:
    die = """
import os, signal, sys
from pathlib import Path
from cltransfer.storage.files import atomic
with atomic(Path(sys.argv[1])) as temporary:
    temporary.touch()
    os.kill(os.getpid(), signal.SIGKILL)
"""
    for name in (VIDEO, "metrics.csv", "notes.txt"):
        subprocess.run([sys.executable, "-c", die, str(tmp_path / name)], check=False)
    (tmp_path / ".tmp-mine-metrics.csv").touch()
    (tmp_path / ".new-7-0123abcd-metrics.csv").touch()  # by which the permissions of a new file are asked for
    left = sorted(path.name for path in tmp_path.rglob(".tmp-*"))
    assert len(left) == 4
    clear(tmp_path)
    kept = sorted(path.name for path in tmp_path.rglob(".tmp-*"))
    assert kept == [name for name in left if name.endswith("notes.txt") or "mine" in name]
    assert not list(tmp_path.glob(".new-*"))


def test_runs_that_are_begun_at_one_time_have_folders_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    names = []
    for number in (1, 2):
        monkeypatch.setattr(os, "getpid", lambda number=number: number)
        names.append(default_folder("s.ply", "r.mp4").name)
    assert [name.rpartition("-")[2] for name in names] == ["1", "2"]


@pytest.mark.parametrize("source", [".", "..", "../..", "..#t=1,2", "/", "builtin:.."])
def test_a_run_lies_in_the_folder_of_its_scene_whatever_its_reference_is_called(source: str) -> None:
    assert default_folder("s.ply", source).parent == Path("outputs/s/run")
    assert default_folder(source, "r.mp4").parent == Path("outputs/run/r")


def test_the_line_that_makes_a_run_again_has_every_digit() -> None:
    up = (0.1234567890123, -1.0, 1e-9)
    words = shlex.split(command_again(Path("run"), Inputs("s.ply", "r.mp4", up=up), []))
    assert up_of(words[words.index("--up") + 1]) == up


def test_only_a_run_that_was_begun_is_resumed(tmp_path: Path) -> None:
    for folder in (tmp_path, tmp_path / "typo"):
        with pytest.raises(UsageError, match=r"--resume: expected the folder of a run, it has no journal.bin"):
            open_run(folder, resume=True)
    assert open_run(killed(tmp_path / "run"), resume=True) == tmp_path / "run"
    assert open_run(tmp_path / "new") == tmp_path / "new"
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").touch()
    with pytest.raises(UsageError, match="is neither empty nor a run"):
        open_run(tmp_path / "full")


def test_a_run_that_was_killed_over_its_first_file_is_written_anew(tmp_path: Path) -> None:
    (tmp_path / f".tmp-7-0123abcd-{MANIFEST}").touch()
    assert open_run(tmp_path) == tmp_path
    (tmp_path / ".tmp-7-0123abcd-thesis.tex").touch()
    with pytest.raises(UsageError, match="is neither empty nor a run"):
        open_run(tmp_path)


@pytest.mark.parametrize("name", [JOURNAL, "trajectory.json", "video"])
def test_a_part_that_is_a_link_out_of_the_run_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / "elsewhere").mkdir()
    run = killed(tmp_path / "run")
    (run / name).unlink(missing_ok=True)
    (run / name).symlink_to(tmp_path / "elsewhere")
    (run / MANIFEST).write_text('{"format": "cltransfer.run"}')
    for refused in (open_run, require_done):
        with pytest.raises(InputError, match="leads out of the folder of its run"):
            refused(run)


def test_every_reader_of_runs_refuses_an_unfinished_one(
    command: Callable[..., Any], tiny_run: Path, tmp_path: Path
) -> None:
    run = shutil.copytree(tiny_run, tmp_path / "run")
    (run / DONE).unlink()
    page, reference = tmp_path / "page", f"builtin:courtyard@{run / 'trajectory.json'}"
    for words in (
        ("render", run),
        ("describe", run),
        ("study", run, tiny_run, "--out", page),
        ("evaluate", tiny_run, run),
        ("inspect", run),
        ("transfer", "builtin:courtyard", run, "--out", tmp_path / "out"),
        ("transfer", "builtin:courtyard", reference, "--out", tmp_path / "out"),
    ):
        answer = command(*words)
        assert (answer.code, "this run was not finished" in answer.err) == (3, True), answer.err


@pytest.mark.parametrize(
    ("words", "read"),
    [
        (("-c", "RUN/config.yaml"), "config.yaml"),
        (("-c", "RUN/../based.yaml"), "config.yaml"),
        (("-c", "RUN/../link.yaml"), "config.yaml"),
        (("--subject", "RUN/subject.json"), "subject.json"),
        (("--subject", "RUN/mine.json"), "labels.safetensors"),
        (("--init", "RUN/trajectory.json"), "trajectory.json"),
        (("builtin:room-3", "builtin:courtyard@RUN/trajectory.json"), "trajectory.json"),
        (("builtin:room-3", "RUN/video/render.mp4#t=0,1"), "video/render.mp4"),
        (("builtin:room-3", "RUN"), ""),
        (("RUN/labels.safetensors", "builtin:orbit"), "labels.safetensors"),
    ],
)
def test_a_run_does_not_replace_what_it_reads(
    command: Callable[..., Any], tiny_run: Path, tmp_path: Path, words: tuple[str, ...], read: str
) -> None:
    run = shutil.copytree(tiny_run, tmp_path / "run")
    (tmp_path / "based.yaml").write_text("base: run/config.yaml\nframes: 2\n")
    (tmp_path / "link.yaml").symlink_to(run / "config.yaml")
    before = {path: path.stat().st_mtime_ns for path in run.rglob("*")}
    refused = command("transfer", "-q", "--out", run, *(word.replace("RUN", str(run)) for word in words))
    assert refused.code == 2, refused.err
    assert ": this run reads it and would replace it (name another --out)" in refused.err
    named = refused.err.removeprefix("error: ").partition(": ")[0]
    assert os.path.realpath(named) == os.path.realpath(run / read)
    assert {path: path.stat().st_mtime_ns for path in run.rglob("*")} == before


def test_what_another_run_has_left_is_read(tmp_path: Path) -> None:
    run = killed(tmp_path / "run")
    refuse_written(tmp_path / "other", [run, run / CONFIG, run / "trajectory.json"])
    refuse_written(run, [run / "mine.yaml", run / "video" / "mine.mp4", tmp_path / CONFIG])


def test_a_run_is_resumed_in_its_own_folder(command: Callable[..., Any], tmp_path: Path) -> None:
    answer = command("transfer", "--resume", tmp_path / "a", "--out", tmp_path / "b")
    assert answer.code == 2
    assert "--out: a run is resumed in its own folder" in answer.err
    assert not list(tmp_path.iterdir())
