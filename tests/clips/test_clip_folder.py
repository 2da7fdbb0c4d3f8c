"""A folder of clips: which it holds, by which names, how fast its images play, and what of it is not scored."""

from __future__ import annotations

import unicodedata
from pathlib import Path

import pytest

from cltransfer.clips.clip_folder import clips_in, left_over, refuse_linked, sources_in
from cltransfer.errors import InputError, UsageError


def a_folder(path: Path, *files: str) -> Path:
    """A folder of empty files, and of folders of them."""
    for name in files:
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        (path / name).touch()
    return path


def test_clips_are_videos_image_folders_and_runs(tmp_path: Path) -> None:
    found = clips_in(a_folder(tmp_path / "all", "b.mkv", "a/0.png", "run/0.png", "notes.txt"))
    assert list(found) == ["a", "b", "run"]
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="found none"):
        clips_in(tmp_path / "empty")
    with pytest.raises(InputError, match="nowhere: clips: no such folder"):
        clips_in(tmp_path / "nowhere")


@pytest.mark.parametrize("name", ["a.mkv", "a"])
def test_a_clip_that_is_a_link_out_of_its_folder_is_refused_and_the_others_are_not(tmp_path: Path, name: str) -> None:
    folder = a_folder(tmp_path / "all", "b/0.png", "notes.txt")
    a_folder(tmp_path / "private", "0.png")
    (folder / name).symlink_to(tmp_path / "private")
    clips = clips_in(folder)
    assert sources_in(f"{folder}#fps=30") == {name: str(folder / name), "b": f"{folder / 'b'}#fps=30"}
    with pytest.raises(InputError, match=rf"all/{name}: is a link that leads out of its folder \(.* name its own fold"):
        refuse_linked(clips[name])
    refuse_linked(clips["b"])
    (folder / name).unlink()
    (folder / name).symlink_to("b")
    (folder / "diary").symlink_to(tmp_path / "private" / "diary.txt")  # which is no clip
    (tmp_path / "mine").symlink_to(folder)
    for clip in clips_in(tmp_path / "mine").values():
        refuse_linked(clip)
    assert left_over(folder, {}) == ["references: diary, notes.txt are not scored: no video by its suffix"]


def test_names_match_however_their_accents_are_written(tmp_path: Path) -> None:
    composed, apart = (unicodedata.normalize(form, "café") for form in ("NFC", "NFD"))
    for folder, name in (("references", composed), ("ours", apart)):
        a_folder(tmp_path / folder, f"{name}.mkv")
    assert clips_in(tmp_path / "ours") == {composed: tmp_path / "ours" / f"{apart}.mkv"}
    assert left_over(tmp_path / "references", {"ours": tmp_path / "ours"}) == []
    (tmp_path / "ours" / composed).mkdir()
    with pytest.raises(InputError, match="two clips have this name"):
        clips_in(tmp_path / "ours")


def test_a_rate_behind_a_folder_is_that_of_the_images_in_it_that_have_none(tmp_path: Path) -> None:
    folder = a_folder(tmp_path / "theirs", "a/0.png", "b/0.png", "b/times.json", "c.mkv")
    named = {"a": str(folder / "a"), "b": str(folder / "b"), "c": str(folder / "c.mkv")}
    assert sources_in(folder) == named
    assert sources_in(f"{folder}#fps=30") == named | {"a": f"{folder / 'a'}#fps=30"}
    assert left_over(f"{folder}#fps=30", {"theirs": f"{folder}#fps=25"}) == []
    a_folder(folder, "run/manifest.json")
    (folder / "run" / "manifest.json").write_text('{"format": "cltransfer.run"}')
    assert sources_in(f"{folder}#fps=30")["run"] == str(folder / "run")


def test_what_is_asked_behind_a_folder_is_asked_of_each_clip_in_it(tmp_path: Path) -> None:
    folder = a_folder(tmp_path / "theirs", "a/0.png", "c.mkv")
    asked = "#t=1.000,2.000&person=1&cuts=keep"
    assert sources_in(f"{folder}#cuts=keep&person=1&t=1,2") == {
        "a": f"{folder / 'a'}{asked}",
        "c": f"{folder / 'c.mkv'}{asked}",
    }
    assert sources_in(f"{folder}#fps=30&t=1") == {
        "a": f"{folder / 'a'}#t=1.000&fps=30",
        "c": f"{folder / 'c.mkv'}#t=1.000",
    }
    assert left_over(f"{folder}#person=1", {"theirs": f"{folder}#t=1"}) == []


@pytest.mark.parametrize(
    ("files", "behind", "told"),
    [
        (
            ("a.mkv",),
            "#fps=30",
            r"#fps: expected folders of images without times\.json in it, found none \(leave it out",
        ),
        (("a/0.png",), "#t=2,1", "#t: expected START,END in seconds"),
        (("a/0.png",), "#fps=many", "#fps: expected images a second"),
    ],
)
def test_what_behind_a_folder_changes_nothing_or_cannot_be_meant_is_refused(
    tmp_path: Path, files: tuple[str, ...], behind: str, told: str
) -> None:
    with pytest.raises(UsageError, match=told):
        sources_in(f"{a_folder(tmp_path / 'theirs', *files)}{behind}")
