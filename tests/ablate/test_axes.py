"""Axes of an ablation file: every combination is a row, called by what it says."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from cltransfer.ablate.axes import MOST
from cltransfer.ablate.read import read_sweep
from cltransfer.ablate.trial import trials
from cltransfer.errors import UsageError

Written = Callable[[str], str]
GRID = "axes: {losses.framing.weight: [5, 20], losses.shot_size.mode: [robust, faithful]}\n"
NAMES = [
    f"losses.framing.weight={weight}, losses.shot_size.mode={mode}"
    for weight in (5, 20)
    for mode in ("robust", "faithful")
]


@pytest.fixture
def written(tmp_path: Path) -> Written:
    def write(text: str) -> str:
        (tmp_path / "sweep.yaml").write_text(text)
        return str(tmp_path / "sweep.yaml")

    return write


def test_every_combination_is_a_row_over_the_base(written: Written) -> None:
    sweep = read_sweep(written(f"base: {{preset: fast, frames: 3}}\n{GRID}"))
    assert [row.name for row in sweep.rows] == NAMES
    told = [(r.config.losses["framing"]["weight"], r.config.losses["shot_size"]["mode"]) for r in sweep.rows]
    assert told == [(5, "robust"), (5, "faithful"), (20, "robust"), (20, "faithful")]
    assert {(row.config.preset, row.config.frames) for row in sweep.rows} == {("fast", 3)}


def test_axes_stand_below_the_rows_that_are_named(written: Written) -> None:
    sweep = read_sweep(written(f"rows: {{as it is: {{}}, short: {{frames: 2}}}}\n{GRID}"), ["steps=3"])
    assert [row.name for row in sweep.rows] == ["as it is", "short", *NAMES]
    assert {row.config.steps for row in sweep.rows} == {3}


def test_null_removes_a_component_and_a_search_replaces_the_other(written: Written) -> None:
    sweep = read_sweep(written("axes: {losses.framing: [{}, null], search: [{paper_box: {}}], engine: [cma]}\n"))
    assert [row.name for row in sweep.rows] == [
        f"losses.framing={framing}, search={{paper_box: {{}}}}, engine=cma" for framing in ("{}", "null")
    ]
    assert ["framing" in row.config.losses for row in sweep.rows] == [True, False]
    assert [list(row.config.search) for row in sweep.rows] == [["paper_box"]] * 2


def test_a_scene_is_an_axis_too(written: Written) -> None:
    meshes = read_sweep(written("axes: {scene: ['builtin:room', 'builtin:plaza']}\n"))
    assert [row.scene.scene for row in meshes.rows if row.scene] == ["builtin:room", "builtin:plaza"]


def test_a_comma_in_a_value_is_none_between_axes(written: Written) -> None:
    """The name of one row is never that of another."""
    (row,) = read_sweep(written("axes: {scene: ['a, frames=2.ply'], frames: [3]}\n")).rows
    assert row.name == "scene='a, frames=2.ply', frames=3"


def test_a_grid_is_the_same_trials_as_its_rows_written_one_by_one(written: Written) -> None:
    grid = read_sweep(written(GRID))
    keys = [trial.key for trial in trials(grid, {})]
    rows = [
        f"  '{name}': {{losses: {{framing: {{weight: {weight}}}, shot_size: {{mode: {mode}}}}}}}"
        for name, (weight, mode) in zip(NAMES, [(5, "robust"), (5, "faithful"), (20, "robust"), (20, "faithful")])
    ]
    by_hand = read_sweep(written("rows:\n" + "\n".join(rows)))
    assert [trial.key for trial in trials(by_hand, {})] == keys
    again = read_sweep(written(grid.to_yaml()))
    assert [(row.name, row.config) for row in again.rows] == [(row.name, row.config) for row in grid.rows]


SEVERAL = ", ".join(map(str, range(1, 16)))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("axes: [1]", "axes: expected keys with their values, got [1] (as losses.framing.weight: [5, 10])"),
        ("axes: {}", "axes: expected keys with their values, got {} (as "),
        ("axes: {1: [2]}", "axes: keys are text, got 1 ("),
        ("axes: {lossses.framing.weight: [5]}", "axes.lossses.framing.weight: no such key (did you mean 'losses'?)"),
        ("axes: {seeds: [0, 1]}", "axes.seeds: no such key"),
        ("axes: {losses..weight: [5]}", "axes.losses..weight: expected names with points between them"),
        ("axes: {frames: []}", "axes.frames: expected a list of one value or more, got []"),
        ("axes: {frames: 3}", "axes.frames: expected a list of one value or more, got 3"),
        ("axes: {losses: {framing: {weight: [5]}}}", "axes.losses: expected a list of one value or more, got {"),
        ("axes: {frames: [3, 4, 3]}", "axes.frames: expected each value once, 3 is there twice"),
        (
            "axes: {losses.framing: [{}, null], losses.framing.weight: [3]}",
            "axes.losses.framing.weight: stands under losses.framing, which is an axis too",
        ),
        ("rows: {'frames=3': {}}\naxes: {frames: [3]}", "rows.frames=3: axes make a row of this name too"),
        (f"axes: {{frames: [{SEVERAL}], steps: [{SEVERAL}]}}", f"axes: make 225 rows, expected {MOST} at most"),
        ("rows: [a]\naxes: {frames: [3]}", "rows: expected name: {overrides}"),
        ("axes: {losses.framng.weight: [5]}", "rows.losses.framng.weight=5: losses.framng: no such loss"),
        ("axes: {losses.framing.wieght: [5]}", "rows.losses.framing.wieght=5: losses.framing.wieght: no such option"),
        ("axes: {seed: [3]}", "rows.seed=3: seed: the sweep has its own"),
        ("rows: {as it is: {}}\naxes: {losses.framing.weight: [10]}", "is the same run as 'as it is'"),
    ],
)
def test_axes_that_cannot_be_meant_are_refused_by_name(written: Written, text: str, told: str) -> None:
    path = written(text)
    with pytest.raises(UsageError) as caught:
        read_sweep(path)
    assert str(caught.value).startswith(path)
    assert told in str(caught.value)
