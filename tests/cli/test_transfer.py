"""A run's folder is one command's from the first look into it to the last file that is written."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from cltransfer.cli.shared import goes_on
from cltransfer.storage.alone import alone
from cltransfer.storage.run_files import FRAMES, JOURNAL

TINY = ("preset=fast", "frames=1", "search_side=48", "output_side=64")


def test_a_folder_that_another_command_writes_into_is_refused(command: Any, tiny_run: Path, tmp_path: Path) -> None:
    run = shutil.copytree(tiny_run, tmp_path / "run")
    before = {path: path.stat().st_mtime_ns for path in run.rglob("*")}
    told = {
        "--out": f"{run}: --out: another process writes a run there (wait until it ends, or name another --out)",
        "--resume": f"{run}: --resume: another process writes a run there (wait until it ends)",
    }
    with alone(run, "works"):
        own = ("render", run, "--out", run / "video" / "render.mp4")
        for words in (("transfer", *TINY, "--out", run), ("transfer", *TINY, "--resume", run), ("render", run), own):
            said, option = command(*words), "--resume" if "--resume" in words else "--out"
            assert (said.code, said.err) == (5, f"error: {told[option]}\n")
        assert command("render", run, "--out", tmp_path / "film.mp4", "-q").code == 0
    assert {path: path.stat().st_mtime_ns for path in run.rglob("*")} == before


def test_a_run_is_locked_until_it_is_written(command: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def second(folder: Path, *_: Any) -> None:
        with alone(folder, "works"):
            pass

    monkeypatch.setattr("cltransfer.run.folder.write_run", second)
    said = command("transfer", *TINY, "-q", "--out", tmp_path / "run")
    assert (said.code, "another process works there" in said.err) == (5, True)
    with alone(tmp_path / "run", "works"):
        pass


def test_a_command_that_cannot_begin_leaves_no_folder(command: Any, tmp_path: Path) -> None:
    assert command("transfer", "missing.ply", *TINY, "--out", tmp_path / "runs" / "first").code == 3
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_finds_no_more_room_names_the_file_and_how_it_goes_on(
    command: Any, tiny_run: Path, tmp_path: Path, room: Callable[[int], None]
) -> None:
    words, run = ("transfer", "-c", tiny_run / "config.yaml", "-q"), tmp_path / "a run"
    way = f"(the same command with --resume '{run}' goes on from here)"
    room((tiny_run / JOURNAL).stat().st_size - 1)
    said = command(*words, "--out", run)
    assert (said.code, said.err) == (5, f"error: {run / JOURNAL}: File too large {way}\n")
    room((tiny_run / FRAMES).stat().st_size - 1)
    said = command(*words, "--resume", run)
    assert said.code == 5
    assert said.err.startswith(f"error: {run}/")
    assert said.err.endswith(f"{way}\n")


def test_where_nothing_was_begun_the_system_is_told_as_it_is(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), goes_on(lambda: ""):
        (tmp_path / "a").open()
