"""What taught a run: another part of that clip, or another person in it, is told; another clip is none of it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from cltransfer.clips.clip import write_video
from cltransfer.clips.image_folder import clip_hash
from cltransfer.clips.source import ClipSource
from cltransfer.clips.taught import taught_notes, taught_otherwise
from cltransfer.errors import InputError
from cltransfer.storage.run_files import DONE, FRAMES, MANIFEST, VIDEO


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    write_video(tmp_path / "a#b.mkv", torch.zeros(2, 3, 16, 16, dtype=torch.uint8), torch.arange(2) / 24, lossless=True)
    return tmp_path / "a#b.mkv"


def run_by(clip: Path, part: str | None) -> ClipSource:
    """A finished run that this ``part`` of a clip taught; None is told by none of before parts were written."""
    folder = clip.parent / "run"
    write_video(folder / FRAMES, torch.zeros(2, 3, 16, 16, dtype=torch.uint8), torch.arange(2) / 24, lossless=True)
    told = {"sha256": clip_hash(clip), **({} if part is None else {"part": part})}
    (folder / MANIFEST).write_text(json.dumps({"format": "cltransfer.run", "reference": told}))
    (folder / DONE).touch()
    return ClipSource(folder)


@pytest.mark.parametrize(
    ("part", "asked", "name"),
    [
        ("t=1.5,4", "", "#t=1.500,4.000"),
        ("t=1.5,4", "#t=1,4", "#t=1.500,4.000"),
        ("b.mkv#t=1.5", "", "#t=1.500"),  # of a clip in whose name there is a #
        ("", "#t=1.5,4", ""),
        ("person=1", "", "#person=1"),
        ("t=0,4", "#person=0.4,0.6", ""),
        ("letterbox=keep", "#cuts=keep", "#letterbox=keep&cuts=keep"),
        ("fps=30", "", "#fps=30"),
        ("", "#fps=30", ""),
    ],
)
def test_what_taught_a_run_is_named_where_it_is_held_against_another_part(
    clip: Path, part: str, asked: str, name: str
) -> None:
    wanted = taught_otherwise(run_by(clip, part), ClipSource.parse(f"{clip}{asked}"))
    assert wanted is not None
    assert wanted.named == f"{clip}{name}"


@pytest.mark.parametrize(
    ("part", "asked"),
    [
        ("t=1.5,4", "#t=1.5,4"),
        ("t=1.5,4", "#t=1.5,3"),  # which is told as frames that have no partner
        ("t=0,4&cuts=keep", ""),
        ("person=0", "#person=0"),
        ("", "#person=0"),  # the largest
        ("fps=24", ""),
        ("b.mkv", ""),
        ("letterbox=crop", ""),
        (None, "#t=1.5,4"),
    ],
)
def test_the_same_moments_and_person_are_none_other_however_named(clip: Path, part: str | None, asked: str) -> None:
    assert taught_otherwise(run_by(clip, part), ClipSource.parse(f"{clip}{asked}")) is None


def test_a_part_of_a_run_goes_with_the_moments_that_taught_it(clip: Path) -> None:
    run = replace(run_by(clip, "t=1.5,4"), span=(1.0, 2.0))
    assert taught_otherwise(run, ClipSource(clip, (2.5, 9.0))) is None
    wanted = taught_otherwise(run, ClipSource(clip, (1.0, 2.0)))
    assert wanted is not None
    assert wanted.span == (2.5, 3.5)


def test_whom_the_persons_of_a_part_of_a_run_are_is_not_known(clip: Path) -> None:
    run = replace(run_by(clip, "t=1,4&person=1"), span=(1.0, 2.0))
    assert taught_otherwise(run, ClipSource(clip, (2.0, 3.0))) is None


def test_whom_a_run_follows_is_nothing_where_it_is_only_shown(clip: Path) -> None:
    run = run_by(clip, "person=1&letterbox=keep")
    assert taught_otherwise(run, ClipSource(clip), shown=True) is None
    run = run_by(clip, "t=2,4&person=1")
    assert taught_otherwise(run, ClipSource(clip), shown=True) == ClipSource(clip, (2.0, 4.0))


def test_a_run_is_known_by_its_video_and_its_reference_by_what_is_in_it(clip: Path, tmp_path: Path) -> None:
    run = run_by(clip, "t=2,4")
    told = ("taught by REFERENCE#t=2.000,4.000, and scored against another part of it, rate or person: name that",)
    copy = ClipSource(clip.rename(tmp_path / "copy.mkv"))
    assert taught_notes(run, copy) == taught_notes(ClipSource(run.path / FRAMES), copy) == told
    write_video(copy.path, torch.ones(2, 3, 16, 16, dtype=torch.uint8), torch.arange(2) / 24, lossless=True)
    assert taught_notes(run, copy) == taught_notes(copy, run) == ()


@pytest.mark.parametrize("video", [FRAMES, VIDEO])
def test_a_run_is_known_by_either_of_its_videos_from_wherever_they_are_named(
    clip: Path, video: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = run_by(clip, "t=2,4")
    monkeypatch.chdir((run.path / video).parent)
    for made in (run.path / video, Path(video.name)):
        assert taught_otherwise(ClipSource(made), ClipSource(clip)) == ClipSource(clip, (2.0, 4.0))


def test_a_run_may_have_taught_another_run(clip: Path) -> None:
    first = run_by(clip, "")
    second = run_by(first.path / FRAMES, "t=2,4")
    assert taught_otherwise(second, first) == ClipSource(first.path, (2.0, 4.0))


def test_a_manifest_that_is_none_of_a_run_is_refused(clip: Path) -> None:
    run = run_by(clip, "")
    (run.path / MANIFEST).write_text('{"format": "cltransfer.run", "reference": "no digest"}')
    with pytest.raises(InputError, match=r"manifest\.json: reference: is no manifest of a run"):
        taught_otherwise(run, ClipSource(clip))
