"""What a killed writer has left is known by its name, of whatever file it was."""

from __future__ import annotations

import re
from pathlib import Path

from cltransfer.storage.files import atomic
from cltransfer.storage.unfinished import clear_left, holds_others, left_in

OURS = re.compile("a.txt|b.txt")


def killed(path: Path) -> Path:
    """A file that has the name under which ``path`` is written."""
    with atomic(path) as temporary:
        temporary.touch()
    temporary.touch()
    path.unlink()
    return temporary


def test_what_is_left_of_a_file_is_found_and_taken_away_and_nothing_else(tmp_path: Path) -> None:
    left, other = killed(tmp_path / "a.txt"), killed(tmp_path / "thesis.tex")
    (tmp_path / ".tmp-7-mine-a.txt").touch()
    assert left_in(tmp_path, OURS) == [left]
    clear_left(tmp_path, OURS)
    assert {path.name for path in tmp_path.iterdir()} == {other.name, ".tmp-7-mine-a.txt"}


def test_a_folder_with_nothing_but_what_is_left_is_as_an_empty_one(tmp_path: Path) -> None:
    assert not holds_others(tmp_path / "missing", OURS)
    assert not holds_others(tmp_path, OURS)
    for name in ("a.txt", "b.txt"):
        killed(tmp_path / name)
    assert not holds_others(tmp_path, OURS)
    killed(tmp_path / "thesis.tex")
    assert holds_others(tmp_path, OURS)


def test_what_is_left_is_known_whatever_stands_in_its_name_and_of_a_longer_name_is_another_s(tmp_path: Path) -> None:
    odd = tmp_path / "a (1) [b].txt"
    assert [killed(odd)] == left_in(tmp_path, re.compile(re.escape(odd.name)))
    probe = tmp_path / ".new-7-01234567-b.txt"  # by which a writer sees who may read a new file
    probe.touch()
    killed(tmp_path / "a.txt.bak")
    assert left_in(tmp_path, OURS) == [probe]
