"""Lines that are kept: whole ones only, whatever moment the writer was killed at."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from cltransfer.errors import InputError, ResourceError
from cltransfer.storage.kept_lines import LONGEST, STRIDE, keep, read_kept

LIMIT = 100  # bytes


def read(path: Path) -> list[Any]:
    return read_kept(path, LIMIT, lambda value: value["name"], "name", lambda size, path: None)


def test_what_was_kept_comes_back_in_order_and_nothing_where_nothing_was(tmp_path: Path) -> None:
    path = tmp_path / "new" / "names.jsonl"
    assert read(path) == []
    for name in "ba":
        keep(path, {"name": name})
    assert read(path) == ["b", "a"]


def test_a_line_that_has_no_room_is_told_with_its_file(tmp_path: Path, room: Callable[[int], None]) -> None:
    path = tmp_path / "names.jsonl"
    room(100)
    keep(path, {"name": "a"})
    with pytest.raises(OSError, match="too large") as caught:
        keep(path, {"name": "b" * 100})
    assert caught.value.filename == str(path)
    assert read(path) == ["a"]


def test_a_line_cut_off_at_any_byte_is_left_out_and_the_next_one_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "names.jsonl"
    keep(path, {"name": "a"})
    first = path.stat().st_size
    keep(path, {"name": "b"})
    whole = path.read_bytes()
    for end in range(first, len(whole)):
        path.write_bytes(whole[:end])
        assert read(path) == ["a"]
        keep(path, {"name": "b"})
        assert path.read_bytes() == whole


def test_a_damaged_line_is_named(tmp_path: Path) -> None:
    path = tmp_path / "names.jsonl"
    keep(path, {"name": "a"})
    keep(path, {"other": 1})
    with pytest.raises(InputError, match="line 2: is no name"):
        read(path)


def test_no_more_is_read_than_was_said(tmp_path: Path) -> None:
    path = tmp_path / "names.jsonl"
    path.write_text("\n" * (LIMIT + 1))
    with pytest.raises(InputError, match=f"expected at most {LIMIT} bytes"):
        read(path)


def test_a_line_that_nothing_here_has_written_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "names.jsonl"
    keep(path, {"name": "a"})
    with path.open("ab") as stream:
        stream.write(b"[" + b"[]," * (2 * LONGEST) + b"[]]\n")
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=f"line 2: expected at most {LONGEST} bytes"):
            read_kept(path, 8 * LONGEST, str, "name", lambda size, path: None)
        assert tracemalloc.get_traced_memory()[1] < 3 * LONGEST
    finally:
        tracemalloc.stop()


def test_no_line_is_read_where_there_is_no_memory_for_it(tmp_path: Path) -> None:
    path, asked = tmp_path / "names.jsonl", list[Any]()

    def afford(size: int, path: Path) -> None:
        asked.append((size, path))
        raise ResourceError(path, "memory", "none is free")

    keep(path, {"name": "a"})
    with pytest.raises(ResourceError, match="none is free"):
        read_kept(path, LIMIT, pytest.fail, "name", afford)
    assert asked == [(path.stat().st_size, path)]


def test_memory_is_asked_for_as_a_file_is_read_and_for_no_more_than_is_read_next(tmp_path: Path) -> None:
    path, left, asked = tmp_path / "names.jsonl", 0, list[int]()
    lengths = [10_000] * 300 + [3 * STRIDE] + [10_000] * 20
    path.write_text("".join(f'"{"a" * (length - 3)}"\n' for length in lengths))

    def afford(size: int, path: Path) -> None:
        nonlocal left
        left = size
        asked.append(size)

    def parse(name: str) -> int:
        nonlocal left
        left -= len(name) + 3
        assert left >= 0
        return len(name) + 3

    assert read_kept(path, 8 * STRIDE, parse, "name", afford) == lengths
    assert asked == [STRIDE, STRIDE, STRIDE, 3 * STRIDE, 200_000]


def test_a_value_without_json_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="JSON"):
        keep(tmp_path / "names.jsonl", {"name": float("nan")})
    assert read(tmp_path / "names.jsonl") == []


def test_a_link_is_not_written_through(tmp_path: Path) -> None:
    (tmp_path / "diary.txt").write_text("no line end")
    (tmp_path / "names.jsonl").symlink_to(tmp_path / "diary.txt")
    with pytest.raises(InputError, match=r"names.jsonl: is a link"):
        read(tmp_path / "names.jsonl")
    assert (tmp_path / "diary.txt").read_text() == "no line end"


def test_a_folder_of_that_name_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="got a folder"):
        read(tmp_path)
