"""Methods are held against the first of them clip by clip, and over clips that both have."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from cltransfer.evaluate_kept import ClipScore
from cltransfer.evaluate_many import summarise
from cltransfer.evaluate_paired import differences
from cltransfer.evaluate_table import methods_csv, methods_json, methods_latex, methods_markdown, write_methods

VALUES = [0.1, 0.9, 0.3, 2.5, 0.6, 1.4, 0.2, 5.0]  # clips differ far more than methods do


def scores(method: str, values: Sequence[float | None]) -> list[ClipScore]:
    return [
        ClipScore(method, f"c{i}", {"framing": value}, {"framing": 0 if value is None else 8}, 8, seconds=2.0)
        for i, value in enumerate(values)
    ]


OURS, THEIRS = scores("ours", VALUES), scores("theirs", [value + 0.05 + 0.01 * i for i, value in enumerate(VALUES)])


def test_a_small_difference_on_every_clip_is_certain_where_intervals_of_the_means_overlap() -> None:
    rows = [*OURS, *THEIRS]
    means = summarise(rows)
    low, high = means["theirs"]["framing"].low, means["ours"]["framing"].high
    assert low is not None
    assert high is not None
    assert low < high
    found = differences(rows)["theirs"]["framing"]
    assert found.estimate.mean == pytest.approx(0.085)
    assert (found.estimate.count, found.alike, found.certain) == (8, True, True)


def test_pairs_are_those_that_both_have_and_none_is_bold_of_others() -> None:
    lost = [*OURS, *scores("theirs", [*(value - 0.1 for value in VALUES[:-1]), None])]
    found = differences(lost)["theirs"]["framing"]
    assert (found.estimate.count, found.estimate.certain, found.alike, found.certain) == (7, True, False, False)
    gone = differences([*OURS, *THEIRS[:-1], ClipScore("theirs", "c7", reason="no such clip")])["theirs"]["framing"]
    assert (gone.estimate.count, gone.alike) == (7, False)
    of_none = [*scores("ours", [*VALUES[:-1], None]), *scores("theirs", [*(v - 0.1 for v in VALUES[:-1]), None])]
    assert differences(of_none)["theirs"]["framing"].certain  # the reference has none: neither is left the easy ones


@pytest.mark.parametrize("other", [{"defined": {"framing": 7}}, {"seconds": 1.5}])
def test_none_is_bold_whose_frames_are_others(other: dict[str, object]) -> None:
    found = differences([*OURS, replace(THEIRS[0], **other), *THEIRS[1:]])["theirs"]["framing"]  # type: ignore[arg-type]
    assert (found.estimate.certain, found.certain) == (True, False)


def test_of_fewer_than_six_clips_a_difference_is_a_mean() -> None:
    found = differences([*OURS[:5], *THEIRS[:5]])["theirs"]["framing"]
    assert (found.estimate.low, found.estimate.count, found.certain) == (None, 5, False)


def test_one_method_differs_from_nobody_and_has_one_table() -> None:
    assert differences(OURS) == {}
    summary = summarise(OURS)
    assert "difference to" not in methods_markdown(summary, {}) + methods_latex(summary, {})


def test_a_second_table_tells_the_differences_in_every_file(tmp_path: Path) -> None:
    third = scores("third", VALUES)
    rows = [*OURS, *THEIRS, *third]
    summary, against = summarise(rows), differences(rows)
    write_methods(tmp_path, rows, summary, against)
    text = (tmp_path / "methods.md").read_text()
    assert text == methods_markdown(summary, against) + "\n"
    first, _, second = text.partition("\nLess ours, clip by clip, over the n clips that both have;")
    assert first.count("\n| ") == 4
    lines = [line for line in second.splitlines() if line.startswith("|")]
    assert [line.split(" | ")[0] for line in lines] == ["| difference to ours", "| ---", "| theirs", "| third"]
    assert lines[2].startswith("| theirs | **+0.085")
    assert lines[3] == "| third | 0.00 [0.00, 0.00] n=8 |"
    assert (tmp_path / "methods.tex").read_text().count(r"\begin{tabular}") == 2
    table = list(csv.DictReader(io.StringIO((tmp_path / "methods.csv").read_text())))
    assert [line["difference_count"] for line in table] == ["", "8", "8"]
    assert float(table[1]["difference_mean"]) == pytest.approx(0.085)
    assert [line["difference_alike"] for line in table] == ["", "True", "True"]
    told = json.loads(json.dumps(methods_json(rows, summary, against), allow_nan=False))["differences"]
    assert list(told) == ["theirs", "third"]
    assert (told["theirs"]["framing"]["certain"], told["third"]["framing"]["certain"]) == (True, False)


def test_a_csv_without_differences_has_the_same_columns() -> None:
    summary = summarise(OURS)
    assert methods_csv(summary).splitlines()[0] == methods_csv(summary, differences([*OURS, *THEIRS])).splitlines()[0]
