"""What is named is told apart by its content, and by that of what goes with it."""

from __future__ import annotations

from pathlib import Path

import pytest

from cltransfer.ablate.content import digest
from cltransfer.errors import InputError
from cltransfer.storage.run_files import DONE, FRAMES, LABELS, MANIFEST, SUBJECT, TRAJECTORY


def test_other_labels_are_another_person(tmp_path: Path) -> None:
    (tmp_path / SUBJECT).write_text("{}")
    seen = []
    for labels in (None, b"a", b"b"):
        if labels is not None:
            (tmp_path / LABELS).write_bytes(labels)
        seen.append(digest(str(tmp_path / SUBJECT)))
    assert len(set(seen)) == 3


def test_a_built_in_scene_is_the_same_by_whatever_its_name_leaves_out() -> None:
    names = ("courtyard", "courtyard-0", "courtyard-0-splats", "courtyard-00")
    assert len({digest(f"builtin:{name}") for name in names}) == 1
    others = ("courtyard-1", "courtyard-0-mesh", "plaza", "orbit")
    assert len({digest(f"builtin:{name}") for name in (*others, "courtyard")}) == 5


def test_a_part_of_a_clip_is_the_same_however_it_is_written(tmp_path: Path) -> None:
    clip = tmp_path / "clip.mp4"
    clip.write_bytes(b"frames")
    assert digest(f"{clip}#t=0") == digest(str(clip))
    assert digest(f"{clip}#person=1&t=1.5,4") == digest(f"{clip}#t=1.50,4.0&person=1")
    parts = ("t=1", "t=1,2", "person=1", "person=0.5,0.5", "cuts=keep", "fps=30")
    assert len({digest(str(clip)), *(digest(f"{clip}#{part}") for part in parts)}) == 7


def test_an_animated_scene_is_another_at_another_moment(tmp_path: Path) -> None:
    scene = tmp_path / "man.glb"
    scene.write_bytes(b"glTF")
    parts = ("t=2", "t=2&animation=Run", "animation=Run")
    assert len({digest(f"{scene}#{part}") for part in parts}) == 3
    assert digest(f"{scene}#animation=Run&t=2.0") == digest(f"{scene}#t=2&animation=Run")


def test_a_view_of_a_set_is_another_than_the_next(tmp_path: Path) -> None:
    views = tmp_path / "transforms.json"
    views.write_text("{}")
    assert len({digest(str(views)), digest(f"{views}:0"), digest(f"{views}:1")}) == 3


def test_a_folder_of_images_is_known_by_what_is_played_of_it(tmp_path: Path) -> None:
    clip, outside = tmp_path / "clip", tmp_path / "outside"
    clip.mkdir()
    for name in ("1.png", "2.png"):
        (clip / name).write_bytes(name.encode())
    before = [digest(str(clip)), digest(f"{clip}#fps=12")]
    outside.write_text("another's")
    (clip / "notes").symlink_to(outside)
    (clip / "Thumbs.db").write_text("left by an explorer")
    assert [digest(str(clip)), digest(f"{clip}#fps=12")] == before
    (clip / "2.png").write_bytes(b"another frame")
    assert not {digest(str(clip)), digest(f"{clip}#fps=12")} & set(before)
    (clip / "3.png").symlink_to(outside)
    with pytest.raises(InputError, match=r"3\.png: is a link that leads out of its folder"):
        digest(str(clip))


def test_a_run_is_known_by_the_frames_that_it_has_kept(tmp_path: Path) -> None:
    for name, text in ((MANIFEST, '{"format": "cltransfer.run"}'), (DONE, ""), (FRAMES, "frames"), (TRAJECTORY, "{}")):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    before = digest(str(tmp_path))
    (tmp_path / "report.html").write_text("looked at")
    assert digest(str(tmp_path)) == before
    (tmp_path / FRAMES).write_text("others")
    assert digest(str(tmp_path)) != before


def test_a_set_is_known_by_all_of_it_and_by_nothing_outside(tmp_path: Path) -> None:
    views, outside = tmp_path / "set", tmp_path / "outside"
    (views / "images").mkdir(parents=True)
    for name in ("transforms.json", "1.png", "images/2.png"):
        (views / name).write_text(name)
    outside.write_text("another's")
    (views / "3.png").symlink_to(outside)
    seen = [digest(f"{views}:0")]
    outside.write_text("still another's")
    assert digest(f"{views}:0") == seen[0]
    for name in ("transforms.json", "1.png", "images/2.png"):
        (views / name).write_text("other")
        seen.append(digest(f"{views}:0"))
    assert len(set(seen)) == 4
