"""Files that are written appear whole, with the permissions of any other new file."""

from __future__ import annotations

import csv
import errno
import io
import os
import stat
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file

from cltransfer.errors import InputError, UsageError
from cltransfer.storage.files import (
    atomic,
    cache_dir,
    check_out,
    content_hash,
    csv_text,
    read_json,
    same_file,
    told_from_here,
    write_text,
)


@pytest.fixture(params=[0o022, 0o002, 0o077])
def umask(request: pytest.FixtureRequest) -> Iterator[int]:
    before = os.umask(request.param)
    yield request.param
    os.umask(before)


def test_who_may_read_a_file_is_as_the_umask_says_whatever_wrote_it(umask: int, tmp_path: Path) -> None:
    with atomic(tmp_path / "a.safetensors") as temporary:
        save_file({"a": torch.zeros(1)}, temporary)
    write_text(tmp_path / "a.txt", "a")
    for name in ("a.safetensors", "a.txt"):
        assert stat.S_IMODE((tmp_path / name).stat().st_mode) == 0o666 & ~umask


def test_threads_that_write_one_file_do_not_take_each_others_half(tmp_path: Path) -> None:
    with atomic(tmp_path / "kept") as one, atomic(tmp_path / "kept") as other:
        assert one != other
        one.write_text("1")
        other.write_text("2")
    assert (tmp_path / "kept").read_text() == "1"
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]


def test_a_file_is_on_the_disk_before_it_has_its_name_and_then_its_name_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced, sync = list[tuple[int, bool]](), os.fsync

    def listed(descriptor: int) -> None:
        synced.append((os.fstat(descriptor).st_ino, (tmp_path / "a.txt").exists()))
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", listed)
    write_text(tmp_path / "a.txt", "a")
    assert synced == [((tmp_path / "a.txt").stat().st_ino, False), (tmp_path.stat().st_ino, True)]


def test_a_file_that_cannot_be_brought_to_the_disk_does_not_replace_the_old_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(descriptor: int) -> None:
        raise OSError(errno.EIO, "Input/output error")

    write_text(tmp_path / "a.txt", "old")
    monkeypatch.setattr(os, "fsync", fails)
    with pytest.raises(OSError, match="Input/output"):
        write_text(tmp_path / "a.txt", "new")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["old"]


def test_a_file_that_has_no_room_is_named(tmp_path: Path, room: Callable[[int], None]) -> None:
    room(100)
    with pytest.raises(OSError, match="too large") as caught:
        write_text(tmp_path / "a.txt", "a" * 200)
    assert caught.value.filename == str(tmp_path / "a.txt")
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_cannot_be_read_while_another_is_written_is_the_one_that_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError) as caught, atomic(tmp_path / "a.txt") as temporary:
        temporary.write_bytes((tmp_path / "gone").read_bytes())
    assert Path(caught.value.filename) == tmp_path / "gone"


def test_a_file_that_fails_half_way_is_not_there_and_the_old_one_is(tmp_path: Path) -> None:
    write_text(tmp_path / "a.txt", "old")
    with pytest.raises(UnicodeEncodeError), atomic(tmp_path / "a.txt") as temporary:
        temporary.write_text("ne\udce9", encoding="utf-8")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["old"]


def test_a_folder_that_cannot_be_made_is_refused_before_anything_is_done(tmp_path: Path) -> None:
    check_out(tmp_path / "a" / "b")
    (tmp_path / "text.txt").touch()
    with pytest.raises(UsageError, match=r"x/y: --out: cannot lie in .*text.txt, which is a file"):
        check_out(tmp_path / "text.txt" / "x" / "y")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_may_not_be_written_is_refused(tmp_path: Path) -> None:
    tmp_path.chmod(0o555)
    with pytest.raises(UsageError, match="--out: may not be written"):
        check_out(tmp_path / "a")


def test_a_pipe_a_device_and_a_folder_stay_what_they_are(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("/dev/null")
    (tmp_path / "folder").mkdir()
    before = sorted(tmp_path.iterdir())
    for name in ("pipe", "link", "folder"):
        with pytest.raises(UsageError, match=f"{name}: is no regular file"):
            write_text(tmp_path / name, "x")
    assert sorted(tmp_path.iterdir()) == before
    assert not any(path.is_file() for path in before)


def test_one_file_by_another_name_is_that_file_there_or_not(tmp_path: Path) -> None:
    (tmp_path / "here").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "here")
    os.link(tmp_path / "here", tmp_path / "again")  # as a system that counts no capitals tells of another spelling
    assert same_file(tmp_path / "here", tmp_path / "link")
    assert same_file(tmp_path / "again", tmp_path / "here")
    assert same_file(tmp_path / "gone", tmp_path / "." / "gone")
    assert not same_file(tmp_path / "gone", tmp_path / "here")


def test_where_no_way_leads_a_path_is_told_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert told_from_here(tmp_path / "run" / "report.html") == os.path.join("run", "report.html")

    def other_drive(path: object) -> str:
        raise ValueError("path is on mount 'D:', start on mount 'C:'")

    monkeypatch.setattr(os.path, "relpath", other_drive)
    assert told_from_here(tmp_path) == str(tmp_path)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("between", [",", ";", "\t", "\n", "\r\n", "; ", ';"', '";', '";"'])
def test_no_part_of_a_text_is_a_formula_whatever_a_spreadsheet_splits_at(separator: str, between: str) -> None:
    """As it does at semicolons where a comma stands before decimals."""
    for sign in "=+-@＝＋－＠":
        text = csv_text([["name", "about"], ["a", f"b{between}{sign}1{between}c"], [f"{sign}1{between}{sign}1", "d"]])
        for line in csv.reader(io.StringIO(text, newline=""), delimiter=separator):
            assert not [cell for cell in line if cell.lstrip().lstrip('"').startswith(sign)]


def test_a_table_is_read_back_as_it_was_written() -> None:
    lines = [["name", "value"], ["a;b", "c\td"], ['"q", r', ""], ["", "x\ny"], ["é", "True"]]
    assert list(csv.reader(io.StringIO(csv_text(lines), newline=""))) == lines
    assert csv_text([[None, True, 3, 0.1, 1e-20]]) == ",True,3,0.1,1e-20\n"


@pytest.mark.parametrize("blank", ["\t", "\n", "\r", "\r\n"])
def test_what_is_behind_a_tab_or_a_new_line_at_the_beginning_is_no_formula(blank: str) -> None:
    """A spreadsheet may leave out such a blank, and works out the rest."""
    ((cell,),) = csv.reader(io.StringIO(csv_text([[f"{blank}=1+1"]]), newline=""))
    assert cell.startswith("'")


def test_files_of_a_folder_are_told_apart_from_one_that_holds_the_names_of_the_others(tmp_path: Path) -> None:
    folders = {"one": {"a": b"1b\x002"}, "two": {"a": b"1", "b": b"2"}, "other": {"a": b"1", "c": b"2"}}
    for folder, files in folders.items():
        (tmp_path / folder).mkdir()
        for name, held in files.items():
            (tmp_path / folder / name).write_bytes(held)
    assert len({content_hash(tmp_path / folder) for folder in folders}) == 3
    listed = [tmp_path / "two" / name for name in "ba"]
    assert content_hash(tmp_path / "two", listed) == content_hash(tmp_path / "two", listed[::-1])


def test_json_of_more_levels_than_python_has_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text("[" * 100_000)
    with pytest.raises(InputError, match=r"a\.json: expected JSON, "):
        read_json(tmp_path / "a.json")


def test_the_cache_lies_where_it_is_named_or_else_where_the_system_keeps_such(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, folder in (("HOME", "/a"), ("XDG_CACHE_HOME", "/b"), ("CLTRANSFER_CACHE", "/c")):
        monkeypatch.setenv(name, folder)
    assert cache_dir() == Path("/c")
    monkeypatch.delenv("CLTRANSFER_CACHE")
    assert cache_dir() == Path("/b/cltransfer")
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache_dir() == Path("/a/.cache/cltransfer")


def test_nobody_waits_for_a_pipe_that_lies_among_files(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.png")
    (tmp_path / "b.png").mkdir()
    for files in ([tmp_path / "a.png"], [tmp_path / "b.png"]):
        with pytest.raises(InputError, match=rf"{files[0].name}: expected a file"):
            content_hash(tmp_path, files)
    with pytest.raises(InputError, match=r"a\.png: expected a file"):
        content_hash(tmp_path / "a.png")
