"""The driver bench: which seeds are meant, whose turn it is, and one clip end to end."""

import math
import shlex
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from cltransfer.bench.driver import Bench, Run, clips_of, drawn, run_driver, seed_range
from cltransfer.bench.driver_table import HEADER, summary, write_driver
from cltransfer.bench.methods import judge_config
from cltransfer.bench.rows import FILE
from cltransfer.bench.section import table
from cltransfer.errors import UsageError


@pytest.mark.parametrize("text", ["500", "seeds=5:5", "seeds=9:3", "seeds=a:b", "0:1001", "seeds=1:2;x"])
def test_a_range_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="seeds=FIRST:LAST"):
        seed_range(text)


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
    (tmp_path / "rows" / FILE).write_text(lines[0] + "\n" + lines[1][:40])  # killed while it was written
    again = run_driver(bench, tmp_path / "rows", told=told.append)
    assert [row["total"] for row in again] == [row["total"] for row in rows]
    assert told[3] == "2 trials, 1 of them done before"
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
