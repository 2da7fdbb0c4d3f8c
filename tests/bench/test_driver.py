"""The driver bench: which seeds are meant, whose turn it is, and one clip end to end."""

import math
import shlex
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
import torch

from cltransfer.bench.driver import Bench, Run, _clip, clips_of, drawn, run_driver, seed_range
from cltransfer.bench.driver_table import HEADER, summary, write_driver
from cltransfer.bench.methods import judge_config
from cltransfer.bench.rows import FILE
from cltransfer.bench.section import table
from cltransfer.camera import Camera
from cltransfer.errors import UsageError
from cltransfer.run.result import Result
from cltransfer.shots import Setup
from cltransfer.subject import Subject
from cltransfer.trajectory import Trajectory


def _dolly(shaken: float = 0.0) -> Camera:
    """Five cameras that move forward, each second one off by ``shaken``."""
    eye = torch.zeros(5, 3, dtype=torch.float64)
    eye[:, 2] = torch.arange(5) / 5 - 6
    eye[::2, 0] += shaken
    return Camera.look_at(eye, eye + torch.tensor([0.0, 0.0, 1.0]), torch.tensor([0.0, -1.0, 0.0]), 0.7, (160, 90))


@pytest.mark.parametrize("text", ["500", "seeds=5:5", "seeds=9:3", "seeds=a:b", "0:1001", "seeds=1:2;x"])
def test_a_range_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="seeds=FIRST:LAST"):
        seed_range(text)


@pytest.mark.parametrize(("target", "position"), [("self", 0.025), ("cross", math.nan)])
def test_a_clip_tells_what_its_path_costs_and_smooths(
    monkeypatch: pytest.MonkeyPatch, target: str, position: float
) -> None:
    true, path = Trajectory(_dolly(0.02), torch.arange(5) / 12), Trajectory(_dolly(0.07), torch.arange(5) / 12)
    result = SimpleNamespace(
        trajectory=path,
        searched=SimpleNamespace(total=0.7),
        spent=SimpleNamespace(evaluations=60),
        seconds={"floaters": 1.0, "initial view": 2.0, "search": 4.0, "render": 100.0},
        scene=SimpleNamespace(subject=SimpleNamespace(height=4.0)),
        kept=SimpleNamespace(
            found=SimpleNamespace(camera=_dolly(0.3)), cameras=path.camera, path=SimpleNamespace(total=0.9, free=0.6)
        ),
    )
    monkeypatch.setattr("cltransfer.bench.driver._judged", lambda run, result, true: 0.5)
    run, subject = Run("fast", target, "pan", 3, 5), cast(Subject, SimpleNamespace(height=2.0))
    clip = _clip(run, cast(Result, result), true, subject)
    assert (clip.preset, clip.target, clip.shot, clip.seed) == ("fast", target, "pan", 3)
    assert (clip.total, clip.judged, clip.evaluations, clip.seconds) == (0.7, 0.5, 12.0, 7.0)
    assert clip.position == pytest.approx(position, nan_ok=True)
    assert clip.extra == pytest.approx(0.3)
    assert (clip.shaken, clip.smooth, clip.true) == pytest.approx((0.3, 0.07, 0.04), rel=1e-6)
    result.kept.path = None
    assert _clip(run, cast(Result, result), true, subject).extra == 0


@pytest.mark.parametrize(
    ("name", "seed", "degrees", "offset"),
    [
        ("push_in", 500, (6.6743, 10.2477), (0.0349, -0.0089)),
        ("handheld", 507, (-36.3379, 3.8402), (0.0218, -0.0311)),
        ("orbit", 519, (41.5537, 8.7452), (-0.1155, 0.0406)),
    ],
)
def test_the_clips_that_were_published_are_drawn_as_they_were(
    name: str, seed: int, degrees: tuple[float, float], offset: tuple[float, float]
) -> None:
    setup = drawn(name, seed)
    assert (math.degrees(setup.azimuth), math.degrees(setup.elevation)) == pytest.approx(degrees, abs=1e-4)
    assert setup.offset == pytest.approx(offset, abs=1e-4)
    assert setup == Setup(setup.azimuth, setup.elevation, offset=setup.offset, seed=seed)  # all else is the shot's own


def test_a_shot_that_is_none_is_one_line() -> None:
    with pytest.raises(UsageError, match=r"shot 'orbitt': no such shot .known: push_in, "):
        Bench(seeds=(0,), shots=("orbitt",))
    with pytest.raises(UsageError, match="shot 'orbitt': no such shot"):
        drawn("orbitt", 0)


def test_the_paper_takes_its_turn_at_every_shot_across_scenes() -> None:
    runs = Bench(seeds=(500, 501, 502), shots=("pan", "zoom", "tilt"), paper_shots=2).runs()
    paper = [run for run in runs if run.preset == "paper"]
    assert {run.target for run in paper} == {"cross"}
    assert [(run.seed, run.shot) for run in paper] == [
        (500, "pan"), (500, "zoom"), (501, "pan"), (501, "tilt"), (502, "zoom"), (502, "tilt")
    ]  # fmt: skip
    assert len({run.key for run in runs}) == len(runs) == 3 * 3 * 2 * 2 + 6


def test_a_key_tells_what_the_judge_scores_by(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Run("fast", "cross", "pan", 0, 24)
    before = run.key
    stricter = partial(judge_config, overrides=("losses.framing.weight=20",))
    monkeypatch.setattr("cltransfer.bench.driver.judge_config", stricter)
    assert run.key != before


def test_a_seed_that_is_named_twice_counts_once() -> None:
    runs = Bench(seeds=(500, 500, 501), shots=("pan", "zoom", "tilt"), paper_shots=2).runs()
    assert runs == Bench(seeds=(500, 501), shots=("pan", "zoom", "tilt"), paper_shots=2).runs()


def test_clips_are_measured_once_and_written_with_their_chart(tmp_path: Path, command: Callable[..., Any]) -> None:
    page = tmp_path / "benchmarks.md"
    page.write_text("# Benchmarks\n")
    bench, told = Bench(seeds=(3,), presets=("fast",), shots=("static",), frames=3), list[str]()
    rows = run_driver(bench, tmp_path / "rows", told=told.append)
    clips = clips_of(rows)
    assert [clip.target for clip in clips] == ["self", "cross"]
    assert clips[0].total < 0.2
    assert 0 < clips[0].judged < 0.2
    assert clips[0].judged != clips[0].total  # read at another size
    assert clips[0].position < 0.01
    assert math.isnan(clips[1].position)
    lines = (tmp_path / "rows" / FILE).read_text().splitlines()
    (tmp_path / "rows" / FILE).write_text("\n".join(lines) + "\n" + lines[1][:40])  # killed while it was written
    again = run_driver(bench, tmp_path / "rows", told=told.append)
    assert [row["total"] for row in again] == [row["total"] for row in rows]
    assert told[3] == "2 trials, 2 of them done before"
    write_driver(rows, page, "cltransfer bench driver")
    assert "driver.svg" in page.read_text()
    drawn = (tmp_path / "driver.svg").read_text()
    assert drawn.startswith("<?xml")
    assert "mathdefault" not in drawn
    assert len((tmp_path / "driver.csv").read_text().splitlines()) == 3
    words = ("bench", "driver", "--preset", "fast", "--shot", "static", "--frames", 3, "--rows", tmp_path / "rows")
    for seeds in (("--seed", 3), ("seeds=3:4",)):
        said = command(*words, *seeds, "--out", tmp_path / "verb.md")
        assert (said.code, said.err) == (0, "2 trials, 2 of them done before\n")
        assert said.out == "\n".join(table(HEADER, summary(clips_of(again)))) + "\n"
        made = f"Made by `cltransfer {shlex.join(map(str, (*words, *seeds)))} --out"
        assert made in (tmp_path / "verb.md").read_text()
