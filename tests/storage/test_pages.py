"""A page is known by the generator in its head; a folder of anything else is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from cltransfer.errors import InputError, UsageError
from cltransfer.storage.foreign import HEAD
from cltransfer.storage.pages import INDEX, check_page

OURS = '<!doctype html><meta name="generator" content="cltransfer study">'


def test_an_empty_folder_and_an_own_page_are_taken(tmp_path: Path) -> None:
    check_page(tmp_path / "new", "cltransfer study", "a page")
    check_page(tmp_path, "cltransfer study", "a page")
    (tmp_path / INDEX).write_text(OURS)
    check_page(tmp_path, "cltransfer study", "a page")


def test_a_folder_whose_page_was_being_written_is_taken(tmp_path: Path) -> None:
    (tmp_path / f".tmp-7-0123abcd-{INDEX}").touch()
    check_page(tmp_path, "cltransfer study", "a page")


@pytest.mark.parametrize(
    ("name", "text"),
    [("notes.txt", OURS), (INDEX, "mine"), (INDEX, OURS.replace("study", "inspect")), (INDEX, " " * HEAD + OURS)],
    ids=["no page", "another page", "of another verb", "far below"],
)
def test_anything_else_is_refused(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(UsageError, match="--out: is neither empty nor a page of a study"):
        check_page(tmp_path, "cltransfer study", "a page of a study")


def test_a_page_whose_parts_lead_elsewhere_is_refused(tmp_path: Path) -> None:
    page, elsewhere = tmp_path / "page", tmp_path / "elsewhere"
    for folder in (page, elsewhere):
        folder.mkdir()
    (page / INDEX).write_text(OURS)
    (page / "videos").symlink_to(elsewhere)
    with pytest.raises(InputError, match="videos: leads out of the folder of its page"):
        check_page(page, "cltransfer study", "a page of a study")
    (page / "videos").unlink()
    (page / "videos").symlink_to(page / "frames")  # which stays in it
    check_page(page, "cltransfer study", "a page of a study")
