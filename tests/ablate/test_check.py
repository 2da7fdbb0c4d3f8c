"""Rows that are the same run are refused where what makes them the same is written."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from cltransfer.ablate.read import read_sweep
from cltransfer.ablate.trial import trials
from cltransfer.errors import UsageError
from cltransfer.losses.framing import Framing
from cltransfer.registry import LOSSES

WEIGHED = "{a: {losses: {framing: {weight: 3}}}, b: {losses: {framing: {weight: 4}}}}"
HINT = "(leave it out, or one of the rows)"


@pytest.mark.parametrize(
    ("rows", "overrides", "line"),
    [
        ("{a: {frames: 3}, b: {frames: 4}}", ["frames=5"], f"frames: makes row 'b' the same run as 'a' {HINT}"),
        (WEIGHED, ["search_side=96", "losses.framing=null"], "losses.framing: makes row 'b' the same"),
        (WEIGHED, ["losses.framing.weight=2", "frames=2"], "losses.framing.weight: makes row 'b' the same"),
        ("{a: {}, b: {engine: cma}}", ["engine=cma", "engine.workers=2"], "engine: makes row 'b' the same"),
        (
            "{a: {}, b: {frames: 4, search_side: 96}}",
            ["frames=5", "search_side=72", "output_side=160"],
            "frames, search_side: make row 'b' the same",
        ),
        ("{a: {}, b: {scene: 'builtin:plaza'}}", ["scenes=['builtin:plaza']"], "scenes: makes row 'b' the same"),
    ],
)
def test_what_the_command_line_makes_the_same_is_named_there(
    tmp_path: Path, rows: str, overrides: list[str], line: str
) -> None:
    file = tmp_path / "sweep.yaml"
    file.write_text(f"rows: {rows}\n")
    assert [row.name for row in read_sweep(str(file)).rows] == ["a", "b"]
    with pytest.raises(UsageError) as caught:
        read_sweep(str(file), overrides)
    assert str(caught.value).startswith(f"command line: {line}")


@pytest.mark.parametrize("overrides", [[], ["frames=5"], ["scenes=['builtin:plaza']"]])
def test_rows_that_are_written_the_same_are_named_in_the_file(tmp_path: Path, overrides: list[str]) -> None:
    file = tmp_path / "sweep.yaml"
    file.write_text("rows: {a: {frames: 3}, b: {frames: 3}}\n")
    with pytest.raises(UsageError, match=r"sweep\.yaml: rows\.b: is the same run as 'a' \(remove one of them\)$"):
        read_sweep(str(file), overrides)


@pytest.mark.parametrize(
    "row", ["losses: {framing: {weight: 10}}", "renderer: {gaussian_splats: {antialiased: true}, mesh: null}"]
)
def test_a_row_that_writes_out_what_is_so_anyway_is_the_same_run(tmp_path: Path, row: str) -> None:
    file = tmp_path / "sweep.yaml"
    file.write_text(f"rows: {{a: {{}}, b: {{{row}}}}}\n")
    with pytest.raises(UsageError, match=r"sweep\.yaml: rows\.b: is the same run as 'a' \(remove one of them\)$"):
        read_sweep(str(file))


def test_rows_whose_components_differ_in_one_option_are_two(tmp_path: Path) -> None:
    file = tmp_path / "sweep.yaml"
    file.write_text("rows: {a: {losses: {framing: {weight: 10}}}, b: {losses: {framing: {weight: 11}}}}\n")
    assert len(read_sweep(str(file)).rows) == 2


def test_a_row_in_the_same_scene_under_another_name_is_the_same_run(tmp_path: Path) -> None:
    file = tmp_path / "sweep.yaml"
    file.write_text("references: ['builtin:orbit']\nrows: {a: {}, c: {scene: 'builtin:courtyard-0'}}\n")
    with pytest.raises(UsageError, match=r"sweep\.yaml: rows\.c: is the same run as 'a' \(remove one of them\)$"):
        trials(read_sweep(str(file)), {})
    file.write_text("references: ['builtin:orbit']\nrows: {a: {}, c: {scene: 'builtin:courtyard-1'}}\n")
    assert [trial.row for trial in trials(read_sweep(str(file)), {})] == ["a", "c"]


def test_each_row_is_built_once_to_be_told_from_all_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a hundred rows there are five thousand pairs."""
    built: list[float] = []

    @dataclass(frozen=True)
    class Counted(Framing):
        def __post_init__(self) -> None:
            built.append(self.weight)

    monkeypatch.setitem(LOSSES._classes, "counted", Counted)
    rows = [f"  row {weight}: {{losses: {{counted: {{weight: {weight}}}}}}}" for weight in range(8)]
    (tmp_path / "sweep.yaml").write_text("\n".join(["rows:", *rows]))
    read_sweep(str(tmp_path / "sweep.yaml"))
    assert sorted(built) == list(range(8))
