"""The frames that a run has kept: shown when its trajectory says, which counts finer than its lossless video."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from cltransfer.clips.clip import write_video
from cltransfer.clips.cuts import check_one_shot
from cltransfer.clips.kept_clip import kept_clip, kept_hash
from cltransfer.clips.open_clip import open_clip
from cltransfer.clips.pairs import open_pairs
from cltransfer.clips.part import find_part
from cltransfer.clips.source import ClipSource
from cltransfer.errors import InputError
from cltransfer.storage.run_files import DONE, FRAMES, MANIFEST, TRAJECTORY
from cltransfer.testing import sample_cameras
from cltransfer.trajectory import Trajectory

COUNT, STEP = 24, 2e-4  # [s]
TIMES = STEP * torch.arange(COUNT).double()


def moving() -> Tensor:
    """Frames of a blotchy wall that moves by three pixels from each to the next."""
    wall = torch.randint(0, 256, (3, 36, 64), generator=torch.Generator().manual_seed(0), dtype=torch.uint8)
    return torch.stack([wall.roll(3 * i, 2) for i in range(COUNT)])


def run_of(folder: Path, image: Tensor, times: Tensor = TIMES) -> ClipSource:
    """A finished run whose video has these frames."""
    write_video(folder / FRAMES, image, times[: len(image)], lossless=True)
    Trajectory(sample_cameras(0, len(times)), times).save(folder / TRAJECTORY)
    (folder / MANIFEST).write_text('{"format": "cltransfer.run"}')
    (folder / DONE).touch()
    return ClipSource(folder)


def test_frames_of_a_run_that_are_closer_than_a_millisecond_go_with_those_that_they_were_made_by(
    tmp_path: Path,
) -> None:
    """By their video the later ones are shown ever later: of 24 frames five were paired, the second with the sixth."""
    write_video(tmp_path / "clip.mp4", moving(), TIMES)
    clip, run = ClipSource(tmp_path / "clip.mp4"), kept_clip(run_of(tmp_path / "run", moving()))
    both, _, notes = open_pairs(clip, run, None)
    assert (len(both.render), notes) == (COUNT, ())
    torch.testing.assert_close(both.shown, TIMES, rtol=0, atol=0)
    torch.testing.assert_close(both.original, TIMES, rtol=0, atol=1e-5)
    assert torch.equal(both.render.image, moving())
    both, _, _ = open_pairs(run, clip, None)
    assert torch.equal(both.original, TIMES)


def test_a_part_of_a_run_and_its_cuts_are_where_its_trajectory_has_them(tmp_path: Path) -> None:
    colours = 255 * torch.rand(2, 3, 9, 16, generator=torch.Generator().manual_seed(1))
    walls = torch.nn.functional.interpolate(colours, scale_factor=4).byte()
    shots, times = walls.repeat_interleave(COUNT, 0), 6e-4 * torch.arange(2 * COUNT).double()
    run = kept_clip(run_of(tmp_path / "run", shots, times))
    with pytest.raises(InputError, match=r"frame 24: a cut at 0\.014 s"):
        check_one_shot(run, find_part(run.path, run.span, run.fps, run.trajectory))
    part = replace(run, span=(0.0144, 1.0))
    assert check_one_shot(part, find_part(part.path, part.span, part.fps, part.trajectory)) == ()
    clip, _ = open_clip(part)
    assert torch.equal(clip.image, shots[COUNT:])
    torch.testing.assert_close(clip.times, times[:COUNT])


def test_a_run_whose_video_was_cut_off_is_refused(tmp_path: Path) -> None:
    run = run_of(tmp_path / "run", moving()[:20])
    with pytest.raises(InputError, match=r"frames\.mkv: frames: expected 24 as in trajectory\.json, got 20 \(make the"):
        open_clip(kept_clip(run))


def test_a_run_that_has_lost_its_trajectory_plays_as_its_video_does(tmp_path: Path) -> None:
    run = run_of(tmp_path / "run", moving(), torch.arange(COUNT).double() / 8)
    (run.path / TRAJECTORY).unlink()
    kept = kept_clip(run)
    assert kept == replace(run, path=run.path / FRAMES)
    torch.testing.assert_close(open_clip(kept)[0].times, torch.arange(COUNT).double() / 8)


def test_any_other_clip_is_itself(tmp_path: Path) -> None:
    clip = ClipSource(tmp_path, (0.0, 1.0), fps=30)
    assert kept_clip(clip) is clip


def test_a_run_is_another_clip_where_its_frames_are_shown_at_other_times(tmp_path: Path) -> None:
    one = run_of(tmp_path / "one", moving())
    other = run_of(tmp_path / "other", moving(), 2 * TIMES)
    assert (one.path / FRAMES).read_bytes() == (other.path / FRAMES).read_bytes()
    assert kept_hash(kept_clip(one)) != kept_hash(kept_clip(other))
    assert kept_hash(kept_clip(one)) == kept_hash(kept_clip(run_of(tmp_path / "again", moving())))
