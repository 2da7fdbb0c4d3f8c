"""The page: blinded, complete in its folder, made of run folders or of clips; the key lies elsewhere."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import time
import zipfile
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import cv2
import pytest
import torch

from cltransfer.clips import part
from cltransfer.clips.clip import read_clip, write_video
from cltransfer.clips.image_folder import clip_hash
from cltransfer.clips.open_clip import ASSUMED
from cltransfer.errors import InputError, ResourceError, UsageError
from cltransfer.report.side_by_side import reference_side, side_by_side
from cltransfer.storage.run_files import BESIDE, FRAMES, TRAJECTORY
from cltransfer.study.build import WRITTEN, Wanted, build_study, write_level
from cltransfer.study.build import page as page_of
from cltransfer.study.design import NO_STUDY, Study, design
from cltransfer.study.shown import clip_of, digest_of, source_of
from cltransfer.trajectory import Trajectory


def test_nothing_in_the_page_tells_whose_video_is_whose(page: tuple[Path, Path]) -> None:
    folder, key = page
    files = [path for path in folder.rglob("*") if path.is_file()]
    assert key not in files
    for path in files:
        assert not re.search(rb"quetzal|ibex|sample", path.read_bytes()), path
        assert not re.search(r"quetzal|ibex|sample", path.name)
    assert "quetzal" in key.read_text()
    videos = list((folder / "videos").iterdir())
    assert len(videos) == 6
    assert len({video.stat().st_mtime for video in videos}) == 1  # written method by method


def test_the_page_goes_into_a_zip(page: tuple[Path, Path], tmp_path: Path) -> None:
    made = shutil.make_archive(str(tmp_path / "page"), "zip", page[0])
    with zipfile.ZipFile(made) as archive:
        inside = [info for info in archive.infolist() if info.filename.endswith(".mp4")]
    assert len(inside) == 6
    assert {info.date_time for info in inside} == {time.localtime(WRITTEN)[:6]}


def test_the_order_of_two_clips_on_the_page_is_that_of_their_tokens() -> None:
    shown = re.findall(r'"clips": \["(\w+)", "(\w+)"\]', page_of(design(["s", "t"], ["a", "b", "c"], [], 0)))
    assert len(shown) == 6
    assert all(first < second for first, second in shown)


def test_the_key_lies_beside_the_page_however_its_folder_is_named(
    clips: Wanted, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "page").mkdir()
    monkeypatch.chdir(tmp_path / "page")
    _, key = build_study(clips, Path())
    assert key == tmp_path / "page.key.json"
    assert not list((tmp_path / "page").rglob("*.key.json"))


def test_the_page_says_that_without_people_it_is_no_study_and_names_no_address(page: tuple[Path, Path]) -> None:
    text = (page[0] / "index.html").read_text()
    assert text.count(NO_STUDY) == 2
    assert NO_STUDY in (page[0] / "README.txt").read_text()
    assert "default-src 'none'" in text
    assert not re.search(r"https?://", text)


def test_one_comparison_is_not_spoken_of_as_several(clips: Wanted, tmp_path: Path, command: Callable[..., Any]) -> None:
    first = ("study", *clips.runs[:2], "--reference", clips.references[0], "--out", tmp_path / "one")
    assert "index.html: 1 comparison\n" in command(*first).out
    assert "<p>One comparison shows a" in (tmp_path / "one" / "index.html").read_text()
    assert ": 1 comparison, 3 questions each." in (tmp_path / "one" / "README.txt").read_text()
    build_study(clips, tmp_path / "two")
    assert "<p>Each of 2 comparisons shows a" in (tmp_path / "two" / "index.html").read_text()
    assert ": 2 comparisons, 3 questions each." in (tmp_path / "two" / "README.txt").read_text()


def test_both_clips_of_a_pair_are_equally_high_and_keep_their_frames(clips: Wanted, tmp_path: Path) -> None:
    small = tmp_path / "small.mp4"
    from cltransfer.clips.clip import write_video

    write_video(small, read_clip(clips.runs[1]).image[..., ::2, ::2].contiguous(), torch.arange(6) / 12)
    wanted = replace(clips, runs=(clips.runs[0], small), references=clips.references[:1])
    study, _ = build_study(wanted, tmp_path / "page")
    found = [read_clip(tmp_path / "page" / "videos" / f"{token}.mp4") for token in study.clips]
    assert [tuple(clip.image.shape) for clip in found] == [(6, 3, 18, 32)] * 2
    torch.testing.assert_close(found[0].times, torch.arange(6).double() / 12, atol=1e-4, rtol=0)


def test_a_clip_that_is_too_large_is_refused_with_what_a_study_can_do(
    clips: Wanted, tiny_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, runs = tmp_path / "page", (tiny_run, another(tiny_run, tmp_path / "other"))
    with monkeypatch.context() as patch:
        patch.setenv("CLTRANSFER_MEMORY", "1")  # MB, less than this process takes
        with pytest.raises(ResourceError, match=r"or cut it, #t=START,END\)$"):
            build_study(clips, out)
        with pytest.raises(ResourceError, match=r"side_by_side\.mp4.* or name the reference: --reference CLIP\)$"):
            build_study(Wanted(runs, ("a", "b")), out)
    monkeypatch.setattr(part, "BYTE_LIMIT", 10)
    with pytest.raises(InputError, match=r"the limit is 10 \(cut it, #t=START,END\)$"):
        build_study(clips, out)
    with pytest.raises(InputError, match=r"side_by_side\.mp4.* is 10 \(name the reference: --reference CLIP\)$"):
        build_study(Wanted(runs, ("a", "b")), out)
    monkeypatch.setattr(part, "FRAME_LIMIT", 5)
    with pytest.raises(InputError, match=r"at most 5 to keep, got 6 \(cut it, #t=START,END\)$"):
        build_study(clips, out)


def test_frames_are_brought_to_one_height_where_there_is_memory_for_it(
    clips: Wanted, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clip = clip_of(source_of(clips.runs[0]))
    monkeypatch.setenv("CLTRANSFER_MEMORY", "1")  # MB, less than this process takes
    with pytest.raises(ResourceError, match=r"quetzal1\.mp4: memory: 6 frames at 32x18, .* need .*, or cut it, #t=S"):
        write_level(tmp_path / "level.mp4", clip, 18)
    assert not (tmp_path / "level.mp4").exists()
    write_level(tmp_path / "level.mp4", clip, 36)  # as high as they are: nothing is copied
    write_video(tmp_path / "as_is.mp4", clip.image, clip.times)
    assert (tmp_path / "level.mp4").read_bytes() == (tmp_path / "as_is.mp4").read_bytes()


def test_the_key_reads_back(page: tuple[Path, Path]) -> None:
    study = Study.load(page[1])
    assert study.methods == ("quetzal", "ibex")
    assert [item.sample for item in study.items] == ["sample1", "sample2"]
    assert {study.clips[item.first].method for item in study.items} == {"quetzal"}
    assert study.to_json().items() <= json.loads(page[1].read_text()).items()


def test_every_pair_of_methods_is_compared_on_every_sample_and_the_seed_names_the_videos() -> None:
    first, again, other = (design(["s", "t"], ["a", "b", "c"], ["x"], seed) for seed in (0, 0, 1))
    assert len(first.items) == 6
    assert first == again
    assert set(first.clips).isdisjoint(other.clips)
    assert first.name != other.name


def another(run: Path, folder: Path, levels: int = 255) -> Path:
    """A copy of a run with other frames."""
    kept = read_clip(shutil.copytree(run, folder) / FRAMES)
    write_video(folder / FRAMES, kept.image ^ levels, kept.times, lossless=True)
    return folder


def test_a_clip_is_not_compared_with_itself(clips: Wanted, tiny_run: Path, tmp_path: Path) -> None:
    copy, out = shutil.copytree(tiny_run, tmp_path / "copy"), tmp_path / "page"
    third = shutil.copy(clips.runs[2], tmp_path / "third.mp4")
    for runs, told in (
        ((tiny_run, tiny_run), f"^{re.escape(str(tiny_run))}: is there twice, expected different ones .or leave this"),
        ((tiny_run, copy), f"^{re.escape(str(copy))}: shows the very frames of {re.escape(str(tiny_run))}, expected"),
        ((tiny_run, tiny_run / FRAMES), f"{FRAMES.name}: shows the very frames of {re.escape(str(tiny_run))}, "),
        ((*clips.runs[:3], clips.runs[2]), r"2\.mp4: is there twice"),
        ((*clips.runs[:3], third), r"third\.mp4: shows the very frames of"),
    ):
        references = clips.references if len(runs) > 2 else (clips.references[0],)
        with pytest.raises(UsageError, match=told):
            build_study(Wanted(runs, ("a", "b"), references), out)
    assert not out.exists()
    build_study(replace(clips, runs=(*clips.runs[:2], *clips.runs[:2])), out)  # in two comparisons


def test_frames_of_a_run_are_shown_when_its_trajectory_says(tiny_run: Path) -> None:
    times = Trajectory.load(tiny_run / TRAJECTORY).times
    assert not torch.equal(times, times.round(decimals=3))  # as its video counts
    assert torch.equal(clip_of(source_of(tiny_run)).times, times)


def test_run_folders_show_their_own_reference(tiny_run: Path, tmp_path: Path, command: Callable[..., Any]) -> None:
    other = another(tiny_run, tmp_path / "other")
    answer = command("study", tiny_run, other, "--out", tmp_path / "page", "--json")
    assert answer.code == 0, answer.err
    assert json.loads(answer.out)["comparisons"] == 1
    videos = {p.stem: read_clip(p).image for p in (tmp_path / "page" / "videos").iterdir()}
    assert {tuple(image.shape) for image in videos.values()} == {(3, 3, 54, 96)}
    (reference,) = (image for name, image in videos.items() if name.endswith("r"))
    sheet = read_clip(tiny_run / "video" / "side_by_side.mp4").image[:, :, 18:72, :96]
    assert float((reference.float() - sheet.float()).abs().mean()) < 8  # levels; it was encoded once more
    manifest = json.loads((other / "manifest.json").read_text())
    manifest["reference"]["sha256"] = "0" * 64
    (other / "manifest.json").write_text(json.dumps(manifest))
    refused = command("study", tiny_run, other, "--out", tmp_path / "again")
    assert refused.code == 3
    assert "is not that of" in refused.err
    (other / "manifest.json").write_text('{"format": "cltransfer.run", "reference": "no digest"}')
    refused = command("study", tiny_run, other, "--out", tmp_path / "again")
    assert refused.code == 3
    assert "is no manifest of a run" in refused.err


def test_runs_that_other_parts_of_a_clip_have_taught_are_no_sample(
    tiny_run: Path, tmp_path: Path, command: Callable[..., Any]
) -> None:
    def study(part: str | None, slower: float = 1.0) -> tuple[int, str]:
        run = another(tiny_run, tmp_path / f"run{next(number)}")
        told, path = (json.loads((run / name).read_text()) for name in ("manifest.json", "trajectory.json"))
        told["reference"]["part"] = part
        path["frames"] = [{**frame, "time": frame["time"] * slower} for frame in path["frames"]]
        (run / "manifest.json").write_text(json.dumps(told))
        (run / "trajectory.json").write_text(json.dumps(path))
        three = ("--method", "a", "--method", "b", "--method", "c", "--out", tmp_path / f"page{next(number)}")
        answer = command("study", tiny_run, second, run, *three)
        return answer.code, answer.err

    number, second = count(), another(tiny_run, tmp_path / "second", 127)
    assert json.loads((tiny_run / "manifest.json").read_text())["reference"]["part"] == ""
    assert study("")[0] == 0
    assert study(None, 2.0)[0] == 0  # an older run, which tells no part
    for code, error in (study("t=0,1"), study("", 2.0)):
        assert code == 3
        assert re.search("run[0-9]+: reference: is not that of .*part of it", error)


def test_a_reference_of_other_moments_than_those_that_taught_a_run_is_refused(
    clips: Wanted, tiny_run: Path, tmp_path: Path
) -> None:
    reference, runs = clips.references[0], []
    for name, levels in (("first", 255), ("second", 127)):
        runs.append(another(tiny_run, tmp_path / name, levels))
        told = json.loads((runs[-1] / "manifest.json").read_text())
        told["reference"] |= {"sha256": clip_hash(Path(reference)), "part": "t=0.25,0.5&person=1"}
        (runs[-1] / "manifest.json").write_text(json.dumps(told))
    with pytest.raises(UsageError, match=rf"--reference: other moments of it taught {runs[0]} .name '{reference}#t=0"):
        build_study(Wanted(tuple(runs), ("a", "b"), (reference,)), tmp_path / "page")
    build_study(Wanted(tuple(runs), ("a", "b"), (f"{reference}#t=0.25,0.5",)), tmp_path / "page")


@pytest.mark.parametrize("height", [36, 37, 270, 288, 289, 720])
def test_the_reference_is_cut_out_of_the_sheet_it_was_put_into(height: int) -> None:
    width = height * 16 // 9
    generator = torch.Generator().manual_seed(0)
    first, second = (
        torch.randint(0, 255, (1, 3, height, width), dtype=torch.uint8, generator=generator) for _ in range(2)
    )
    cut = reference_side(side_by_side(first, second, torch.zeros(1)))
    assert abs(cut.shape[2] - height) <= 1
    assert abs(cut.shape[3] - width) <= 1
    both = (slice(None), slice(None), slice(min(cut.shape[2], height)), slice(min(cut.shape[3], width)))
    assert torch.equal(cut[both], first[both])


def test_what_does_not_go_together_is_refused(clips: Wanted, tmp_path: Path) -> None:
    out = tmp_path / "page"
    with pytest.raises(UsageError, match=r"expected 2 for each sample \(quetzal, ibex\) \(got 3\)"):
        build_study(replace(clips, runs=clips.runs[:3]), out)
    with pytest.raises(UsageError, match="expected one for each of 2 samples"):
        build_study(replace(clips, references=clips.references[:1]), out)
    with pytest.raises(UsageError, match="clips do not know theirs"):
        build_study(replace(clips, references=()), out)
    with pytest.raises(UsageError, match="all different"):
        build_study(replace(clips, methods=("a", "a")), out)
    with pytest.raises(InputError, match="no such file"):
        build_study(replace(clips, runs=(*clips.runs[:3], tmp_path / "none.mp4")), out)
    assert not (out / "index.html").exists()
    taken = tmp_path / "taken"
    taken.mkdir()
    (taken / "thesis.tex").write_text("")
    with pytest.raises(UsageError, match="neither empty nor a page"):
        build_study(clips, taken)


def test_a_page_that_failed_part_way_leaves_nothing_and_can_be_made_again(clips: Wanted, tmp_path: Path) -> None:
    out, last = tmp_path / "page", Path(clips.runs[-1])
    whole, before = last.read_bytes(), {p.name for p in tmp_path.iterdir()}
    last.write_bytes(b"no clip")
    with pytest.raises(InputError):
        build_study(clips, out)
    assert {p.name for p in tmp_path.iterdir()} == before
    last.write_bytes(whole)
    out.mkdir()
    left = out / ".tmp-7-0123abcd-index.html"
    left.touch()  # by one that was killed as it wrote
    made = build_study(clips, out)
    assert not left.exists()
    (out / "videos" / "mine.mp4").write_bytes(b"")
    os.utime(out / "videos" / "mine.mp4", (7, 7))
    assert build_study(clips, out) == made
    assert (out / "videos" / "mine.mp4").stat().st_mtime == 7


def test_somebodys_site_is_not_taken_for_a_page(clips: Wanted, tmp_path: Path) -> None:
    out = tmp_path / "site"
    out.mkdir()
    (out / "index.html").write_bytes(b"<title>mine \xff</title>")
    with pytest.raises(UsageError, match="neither empty nor a page of a study"):
        build_study(clips, out)
    assert [p.name for p in out.iterdir()] == ["index.html"]


def test_the_key_of_another_study_is_not_replaced(page: tuple[Path, Path], clips: Wanted) -> None:
    folder, key = page
    before = key.read_bytes()
    with pytest.raises(UsageError, match="is the key of another study"):
        build_study(replace(clips, seed=6), folder)
    assert key.read_bytes() == before
    build_study(clips, folder)  # the same one may be made again


def images(folder: Path, count: int) -> Path:
    folder.mkdir()
    generator = torch.Generator().manual_seed(1)
    for i, rgb in enumerate(torch.randint(0, 255, (count, 36, 64, 3), dtype=torch.uint8, generator=generator)):
        assert cv2.imwrite(str(folder / f"{i}.png"), rgb.numpy())
    return folder


def test_images_play_at_the_rate_and_in_the_part_that_is_named(
    clips: Wanted, tmp_path: Path, command: Callable[..., Any]
) -> None:
    first, second = images(tmp_path / "first", 6), images(tmp_path / "second", 6)
    words = (f"{first}#fps=10", f"{second}#fps=10&t=0.2,0.4", "--reference", f"{clips.references[0]}#t=0,0.25")
    answer = command("study", *words, "--out", tmp_path / "page", "--json")
    assert answer.code == 0, answer.err
    assert json.loads(answer.out)["notes"] == []
    key = json.loads((tmp_path / "page.key.json").read_text())
    assert key["runs"] == [{"A": words[0], "B": words[1]}]
    study = Study.load(tmp_path / "page.key.json")
    times = {
        clip.method: read_clip(tmp_path / "page" / "videos" / f"{token}.mp4").times
        for token, clip in study.clips.items()
    }
    torch.testing.assert_close(times["A"], torch.arange(6).double() / 10, atol=1e-4, rtol=0)
    torch.testing.assert_close(times["B"], torch.arange(3).double() / 10, atol=1e-4, rtol=0)
    (reference,) = (tmp_path / "page" / "videos").glob("*r.mp4")
    assert len(read_clip(reference)) == 4


def test_a_rate_that_nothing_says_is_told_of_every_clip(
    clips: Wanted, tmp_path: Path, command: Callable[..., Any]
) -> None:
    folder = images(tmp_path / "first", 6)
    answer = command("study", folder, f"{folder}#fps=24", "--reference", folder, "--out", tmp_path / "page")
    assert answer.code == 0, answer.err
    assert answer.out.splitlines()[2:] == [f"note: {folder}: {ASSUMED}"]


def test_another_part_of_a_clip_makes_another_study(clips: Wanted, tmp_path: Path) -> None:
    def named(part: str) -> str:
        runs = tuple(f"{run}{part}" for run in clips.runs)
        return build_study(replace(clips, runs=runs), tmp_path / f"page{part}")[0].name

    assert len({named(""), named("#t=0,0.2"), named("#t=0.1,0.3")}) == 3


def test_what_else_lies_in_the_folder_of_a_run_is_not_read(tiny_run: Path, tmp_path: Path) -> None:
    run = another(tiny_run, tmp_path / "run")

    def named(out: str) -> str:
        return build_study(Wanted((str(tiny_run), str(run)), ("a", "b")), tmp_path / out)[0].name

    usual = named("page1")
    (tmp_path / "diary").write_text("of somebody else")
    (run / "video" / "linked").symlink_to(tmp_path / "diary")
    assert named("page2") == usual
    kept = read_clip(run / "video" / "frames.mkv")
    write_video(run / "video" / "frames.mkv", kept.image ^ 127, kept.times, lossless=True)
    frames = named("page3")
    sheet = read_clip(run / BESIDE, max_side=8192)
    write_video(run / BESIDE, sheet.image ^ 127, sheet.times)
    assert len({usual, frames, named("page4")}) == 3


def test_what_else_lies_in_a_folder_of_images_is_not_read(clips: Wanted, tmp_path: Path) -> None:
    folder = images(tmp_path / "first", 4)
    usual = digest_of(source_of(folder))
    (tmp_path / "diary").write_text("of somebody else")
    (folder / "notes").symlink_to(tmp_path / "diary")
    assert digest_of(source_of(folder)) == usual
    (folder / "times.json").write_text("[0, 1, 2, 3]")
    assert digest_of(source_of(folder)) != usual


def test_other_references_make_another_study(clips: Wanted, tmp_path: Path) -> None:
    number = count()

    def named(*references: object) -> str:
        wanted = replace(clips, references=tuple(map(str, references)))
        return build_study(wanted, tmp_path / f"page{next(number)}")[0].name

    first, second = clips.references
    copy = shutil.copy(first, tmp_path / "copy.mp4")
    usual = named(first, second)
    assert named(copy, second) == usual  # by content, wherever it lies
    assert len({usual, named(second, first), named(first, first), named(first, f"{second}#t=0,0.2")}) == 4


def test_a_part_that_a_study_cannot_show_is_refused(tiny_run: Path, clips: Wanted, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="#person: expected a whole clip"):
        build_study(replace(clips, runs=(f"{clips.runs[0]}#person=1", *clips.runs[1:])), tmp_path / "page")
    with pytest.raises(UsageError, match="a part of a run does not know its own"):
        build_study(Wanted((f"{tiny_run}#t=0,1", str(tiny_run)), ("a", "b")), tmp_path / "page")


def test_a_run_whose_frames_were_cut_off_is_refused(tmp_path: Path) -> None:
    runs = []
    for name, kept, beside in (("whole", 30, 30), ("cut", 3, 30), ("sheet", 30, 4)):
        grey = torch.full((30, 3, 32, 48), 90 + len(runs), dtype=torch.uint8)
        run = tmp_path / name
        (run / "video").mkdir(parents=True)
        (run / "DONE").touch()
        (run / "manifest.json").write_text('{"format": "cltransfer.run", "reference": {"sha256": "0"}}')
        (run / "metrics.json").write_text('{"frames": 30}')
        write_video(run / "video" / "frames.mkv", grey[:kept], torch.arange(kept) / 24, lossless=True)
        write_video(run / "video" / "side_by_side.mp4", grey[:beside], torch.arange(beside) / 24)
        runs.append(run)
    wanted = Wanted(tuple(runs[:2]), ("A", "B"), (runs[0] / "video" / "frames.mkv",))
    with pytest.raises(InputError, match=r"frames.mkv: video: has 3 frames, its run 30"):
        build_study(wanted, tmp_path / "page")
    # the reference is cut from the one beside it
    with pytest.raises(InputError, match=r"side_by_side.mp4: video: has 4 frames, its run 30"):
        build_study(Wanted((runs[2], runs[0]), ("A", "B")), tmp_path / "page")


def test_the_command_beside_the_page_can_be_pasted(clips: Wanted, tmp_path: Path) -> None:
    build_study(clips, tmp_path / "my page")
    text = (tmp_path / "my page" / "README.txt").read_text()
    line = next(line for line in text.splitlines() if "--key" in line)
    assert shlex.split(line)[-1] == "my page.key.json"


@pytest.mark.parametrize(("part", "rows"), [("", 36), ("#letterbox=crop", 24)])
def test_black_bars_are_shown_unless_they_are_to_go(tmp_path: Path, part: str, rows: int) -> None:
    image = torch.zeros(2, 3, 36, 64, dtype=torch.uint8)
    image[:, :, 6:30] = 200
    write_video(tmp_path / "wide.mkv", image, torch.arange(2) / 24, lossless=True)
    assert clip_of(source_of(f"{tmp_path / 'wide.mkv'}{part}")).image.shape[2] == rows
