"""Two clips scored: frames are paired by time, and what their times are taken to be is told."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import pytest
import torch
from torch import Tensor

from cltransfer.clip import write_video
from cltransfer.config import load_config
from cltransfer.config_options import RunConfig
from cltransfer.evaluate import evaluate
from cltransfer.open_clip import ASSUMED


def pan() -> Tensor:
    """Ten frames of a camera that pans ever faster over a blotchy wall."""
    coarse = torch.rand(1, 3, 9, 40, generator=torch.Generator().manual_seed(0))
    wall = torch.nn.functional.interpolate(coarse, (48, 200), mode="bilinear")[0]
    return torch.stack([wall[:, :, i * i : i * i + 64] for i in range(10)]).mul(255).byte()


def images(folder: Path, image: Tensor) -> Path:
    folder.mkdir()
    for i, rgb in enumerate(image):
        assert cv2.imwrite(str(folder / f"{i}.png"), rgb.permute(1, 2, 0).numpy()[..., ::-1])
    return folder


@pytest.fixture
def config(mean_flow: tuple[str, ...]) -> RunConfig:
    return load_config(overrides=mean_flow)


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    """A video of 30 frames a second; what is exported of it lies in ``frames``."""
    write_video(tmp_path / "clip.mkv", pan(), torch.arange(10).double() / 30, lossless=True)
    images(tmp_path / "frames", pan())
    return tmp_path / "clip.mkv"


def test_the_images_of_a_clip_at_its_rate_score_zero(clip: Path, config: RunConfig) -> None:
    folder = clip.with_name("frames")
    for pair in ((clip, f"{folder}#fps=30"), (f"{folder}#fps=30", clip)):
        report = evaluate(*map(str, pair), config)
        assert report.scores.totals.tolist() == [0.0] * 10
        assert report.notes == ()


def test_images_whose_rate_nothing_says_are_told(clip: Path, config: RunConfig) -> None:
    folder = str(clip.with_name("frames"))
    report = evaluate(str(clip), folder, config)
    assert float(report.scores.totals.sum()) > 0  # 24 images a second are other moments
    assert f"render: {ASSUMED}" in report.notes
    assert f"reference: {ASSUMED}" in evaluate(folder, str(clip), config).notes


@pytest.mark.parametrize(("count", "rate", "told"), [(10, 30, True), (9, 30, False), (10, 24, False)])
def test_an_image_for_each_frame_of_the_reference_is_told_where_its_times_are_not_taken(
    tmp_path: Path, config: RunConfig, count: int, rate: int, told: bool
) -> None:
    write_video(tmp_path / "clip.mkv", pan(), torch.arange(10).double() / rate, lossless=True)
    folder = images(tmp_path / "frames", pan()[:count])
    few = replace(config, frames=3)
    notes = evaluate(str(tmp_path / "clip.mkv"), str(folder), few).notes
    wanted = "render: it has as many images as the reference has frames, 10: "
    assert [note.removeprefix(wanted) for note in notes if note.startswith(wanted)] == [
        "if its times are meant, name FOLDER#fps=30 or write a times.json"
    ] * told


def test_a_run_is_scored_by_the_frames_it_has_kept(
    command: Any, mean_flow: tuple[str, ...], clip: Path, tmp_path: Path
) -> None:
    run = tmp_path / "run"
    write_video(run / "video" / "frames.mkv", pan(), torch.arange(10).double() / 30, lossless=True)
    write_video(run / "video" / "render.mp4", pan() // 2, torch.arange(10).double() / 30)
    (run / "manifest.json").write_text("{}")
    pairs = ((clip, run), (run, clip), (f"{clip}#t=0,0.2", f"{run}#t=0,0.2"))
    for pair in pairs:
        killed = command("evaluate", *pair, *mean_flow, "--quiet")
        assert (killed.code, killed.err.count("\n")) == (3, 1)
        assert f"{run}: DONE: this run was not finished" in killed.err
    (run / "DONE").touch()
    for pair, title in zip(pairs, ("run against clip.mkv", "clip.mkv against run", "run against clip.mkv")):
        answer = command("evaluate", *pair, *mean_flow, "--quiet", "--json")
        assert answer.code == 0, answer.err
        said = json.loads(answer.out)
        assert (said["metrics"]["total"]["mean"], said["title"]) == (0, title)
    assert command("evaluate", clip, f"{run}#fps=30", *mean_flow, "--quiet").code == 2


def test_notes_are_printed_and_kept(command: Any, mean_flow: tuple[str, ...], clip: Path, tmp_path: Path) -> None:
    answer = command("evaluate", clip, clip.with_name("frames"), *mean_flow, "--quiet", "--out", tmp_path / "out")
    assert answer.code == 0, answer.err
    assert f"\nnote: render: {ASSUMED}\n" in answer.out
    flags = json.loads((tmp_path / "out" / "metrics.json").read_text())["flags"]
    assert {"frame": None, "reason": f"render: {ASSUMED}"} in flags
