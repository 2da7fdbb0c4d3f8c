"""Runs of the driver bench put together from their CSVs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

from cltransfer.bench.driver import Clip
from cltransfer.bench.driver_chart import COLUMNS, write_driver_chart
from cltransfer.bench.pool import by_shot, read_clips, read_together, report_lines
from cltransfer.bench.pool_chart import draw
from cltransfer.errors import InputError

NAN = float("nan")
CLIP = Clip("fast", "cross", "pan", 1, 0.5, 0.6, 12.0, 2.0, NAN, NAN, NAN, 0.1, 0.2, 0.02, 0.01)
PAPER = replace(CLIP, preset="paper", total=1.0, judged=0.5, evaluations=960.0)
WRONG = [
    ("preset,total\nfast,1\n", "line 1: expected the columns preset,"),
    (",".join(COLUMNS) + "\n", "expected clips, has none"),
    (",".join(COLUMNS) + "\nfast,cross,pan,1\n", "line 2: expected 15 values"),
    (",".join(COLUMNS) + "\nfast,cross,pan,1.5,1,1,1,1,,,,,,,\n", "line 2: expected numbers behind the names"),
    (",".join(COLUMNS) + "\nfast,cross,pan,1,,1,1,1,,,,,,,\n", "line 2: expected a total, evaluations and seconds"),
    (",".join(COLUMNS) + '\n"fast,cross', "expected CSV"),
    (
        ",".join(COLUMNS) + "\nfast,cross,pan,1,1,inf,1,1,,,,,,,\n",
        "line 2: expected a total, evaluations and seconds, and",
    ),
    (",".join(COLUMNS) + "\nfaster,cross,pan,1,1,1,1,1,,,,,,,\n", "line 2: expected a preset, got 'faster' (balanced,"),
]


def test_what_the_driver_bench_writes_is_read_again(tmp_path: Path) -> None:
    clips = [replace(CLIP, target="self", position=0.25, rotation=0.5, focal=0.125), CLIP, PAPER]
    write_driver_chart(clips, tmp_path)
    assert repr(read_clips(tmp_path / "driver.csv")) == repr(clips)  # NaN equals nothing


@pytest.mark.parametrize(("text", "reason"), WRONG, ids=[reason for _, reason in WRONG])
def test_other_files_are_refused(tmp_path: Path, text: str, reason: str) -> None:
    (tmp_path / "clips.csv").write_text(text)
    with pytest.raises(InputError) as caught:
        read_clips(tmp_path / "clips.csv")
    assert reason in str(caught.value)


def test_a_clip_in_two_files_does_not_count_twice(tmp_path: Path) -> None:
    for name in ("one", "two"):
        write_driver_chart([CLIP], tmp_path / name)
    with pytest.raises(InputError, match="fast cross pan 1: stands twice"):
        read_together([tmp_path / "one" / "driver.csv", tmp_path / "two" / "driver.csv"])


def test_shots_are_held_against_the_paper_s_setting_one_by_one() -> None:
    clips = [CLIP, PAPER, replace(CLIP, shot="zoom", total=3.0, judged=NAN), replace(PAPER, shot="zoom")]
    header, rows = by_shot([*clips, replace(CLIP, shot="orbit"), replace(CLIP, target="self")])
    assert header[3:] == ["fast: at or below", "share of paper's mean", "judged at or below", "evaluations a frame"]
    assert rows[:2] == [
        ["pan", "1", "1.000", "1 of 1", "0.50", "0 of 1", "12.0"],
        ["zoom", "1", "1.000", "0 of 1", "3.00", "", "12.0"],
    ]
    assert rows[2][:3] == ["all", "2", "1.000"]
    assert rows[2][3] == "1 of 2: 50.0 % [1.3 %, 98.7 %]"
    assert rows[2][5] == "0 of 1: 0.0 % [0.0 %, 97.5 %]"


def test_a_preset_that_met_the_paper_s_setting_nowhere_has_empty_cells() -> None:
    assert by_shot([CLIP, replace(PAPER, shot="zoom")])[1] == [
        ["zoom", "1", "1.000", "", "", "", ""],
        ["all", "1", "1.000", "", "", "", ""],
    ]


def test_totals_of_other_losses_are_not_held_against_the_paper_s_setting() -> None:
    clips = [replace(CLIP, preset="jaws_clean", total=0.1), PAPER]
    assert by_shot(clips)[1][0] == ["pan", "1", "1.000", "", "", "0 of 1", "12.0"]
    figure = Figure()
    draw(figure, clips)
    assert [len(ax.collections[0].get_offsets()) for ax in figure.axes] == [0, 1]


def test_nothing_is_a_share_of_a_total_of_zero() -> None:
    assert by_shot([CLIP, replace(PAPER, total=0.0)])[1][0] == ["pan", "1", "0.000", "0 of 1", "", "0 of 1", "12.0"]


def test_without_the_paper_s_setting_there_is_nothing_to_hold_against() -> None:
    assert by_shot([CLIP])[1] == [["all", "0", "", "", "", "", ""]]


def test_the_verb_writes_its_section_and_its_chart(tmp_path: Path, command) -> None:
    write_driver_chart([CLIP, PAPER], tmp_path)
    said = command("bench", "pool", tmp_path / "driver.csv", "--out", tmp_path / "page.md")
    assert (said.code, said.err) == (0, "")
    assert "| pan | 1 | 1.000 | 1 of 1 | 0.50 | 0 of 1 | 12.0 |" in said.out
    assert said.out.strip() in (tmp_path / "page.md").read_text()
    assert ">the paper's setting</text>" in (tmp_path / "pool.svg").read_text()


def test_the_chart_has_a_dot_for_what_both_sides_know() -> None:
    def dots(clips: list[Clip]) -> list[Any]:
        figure = Figure()
        draw(figure, clips)
        return [ax.collections[0].get_offsets().tolist() for ax in figure.axes]

    assert dots([CLIP, PAPER]) == [[[1.0, 0.5]], [[0.5, 0.6]]]
    assert dots([replace(CLIP, judged=NAN), PAPER]) == [[[1.0, 0.5]], []]
    assert dots([CLIP]) == [[], []]


def test_a_total_that_is_drawn_higher_than_it_is_is_told() -> None:
    figure = Figure()
    draw(figure, [replace(CLIP, total=1e-4), PAPER])
    assert [ax.get_title().partition(" (")[2] for ax in figure.axes] == ["below 0.001 at 0.001)", ""]
    assert figure.axes[0].collections[0].get_offsets().tolist() == [[1.0, 0.001]]
    assert figure.axes[0].get_ylim()[0] < 0.001


def test_losses_are_built_once_a_preset_and_not_for_each_clip(monkeypatch: pytest.MonkeyPatch) -> None:
    """The clips of ninety seeds took minutes."""
    asked: list[str] = []

    def told(preset: str) -> bool:
        asked.append(preset)
        return True

    for module in ("pool", "driver_table"):
        monkeypatch.setattr(f"cltransfer.bench.{module}.comparable", told)
    clips = [replace(CLIP, preset=preset, seed=seed) for preset in ("fast", "paper") for seed in range(20)]
    report_lines(clips)
    assert asked == ["fast", "fast"]  # of either table
