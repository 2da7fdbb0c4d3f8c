import csv
import io
import json
import sys
from dataclasses import replace

import pytest
import torch

from cltransfer.cli.shared import show
from cltransfer.pipeline.scores import Scores, Term
from cltransfer.report.data import Flag
from cltransfer.report.metrics import FIRST_VIEW, metrics_json, metrics_table, number, rows, sums, write_metrics
from cltransfer.report.page import page

NAN = float("nan")


def term(name: str, values: list[float], reason: str = "") -> Term:
    return Term(name, "frame", 2.0, torch.tensor(values, dtype=torch.float64), reason)


def test_rows_count_what_is_defined_and_compare_with_the_first_view(report):
    size, movement, total = rows(report)
    assert (size.mean, size.weighted, size.baseline) == pytest.approx((0.02, 0.04, 0.2))
    assert size.ratio == pytest.approx(10)
    assert (movement.defined, movement.frames, movement.mean) == (3, 4, pytest.approx(0.2))
    assert movement.reason == "no frame before the first"
    assert total.mean == pytest.approx((0.02 + 0.34 + 0.66 + 0.94) / 4)


def test_a_term_without_any_value_has_no_mean_and_no_ratio(report):
    terms = (term("shot_size", [NAN] * 4), term("camera_movement", [0.0] * 4))
    size, movement, _ = rows(replace(report, scores=Scores(terms, torch.ones(4))))
    assert (size.mean, size.weighted, size.ratio, size.defined) == (None, None, None, 0)
    assert movement.ratio is None  # nothing is any number of times as large as 0
    assert size.cells()[1] == "–"


@pytest.mark.parametrize(("command", "told"), [("", None), ("cltransfer transfer", "cltransfer transfer")])
def test_the_command_that_makes_it_again_is_null_where_there_is_none(report, command, told):
    assert metrics_json(replace(report, command=command))["command"] == told


def test_metrics_json_holds_null_and_a_reason_where_undefined(report, tmp_path):
    write_metrics(tmp_path, report)
    text = (tmp_path / "metrics.json").read_text()
    assert "NaN" not in text
    movement = json.loads(text)["metrics"]["camera_movement"]
    assert movement["values"] == [None, 0.1, 0.2, 0.3]
    assert movement["reason"] == "no frame before the first"
    assert json.loads(text)["spent"]["rate"] is None


def test_a_missing_value_without_a_given_reason_still_says_so(report, tmp_path):
    unexplained = Scores((term("framing", [NAN, 1.0, 1.0, 1.0]),), torch.ones(4, dtype=torch.float64))
    write_metrics(tmp_path, replace(report, scores=unexplained))
    metric = json.loads((tmp_path / "metrics.json").read_text())["metrics"]["framing"]
    assert metric["reason"] == "undefined on the first frame"
    for values in ([1.0, NAN, 1.0, 1.0], [NAN, 1.0, NAN, 1.0]):
        gaps = Scores((term("framing", values),), torch.ones(4, dtype=torch.float64))
        write_metrics(tmp_path, replace(report, scores=gaps))
        metric = json.loads((tmp_path / "metrics.json").read_text())["metrics"]["framing"]
        assert metric["reason"] == "undefined on some frames"


@pytest.mark.parametrize(("value", "told"), [(999.4, "999"), (999.7, "1000"), (99.96, "100"), (0.5, "0.500"), (7, "7")])
def test_a_number_has_three_digits_and_no_exponent_where_it_is_rounded_up(value, told):
    assert number(value) == told


def test_metrics_csv_has_one_row_per_frame_and_empty_cells_where_undefined(report, tmp_path):
    write_metrics(tmp_path, report)
    table = list(csv.DictReader(io.StringIO((tmp_path / "metrics.csv").read_text())))
    assert list(table[0]) == ["frame", "time", "shot_size", "camera_movement", "total", "flags"]
    assert len(table) == 4
    assert table[0]["camera_movement"] == ""
    assert table[0]["flags"] == "camera_movement is undefined"
    assert float(table[2]["total"]) == pytest.approx(2 * 0.03 + 3 * 0.2)


def test_no_name_in_metrics_csv_is_a_formula(report, tmp_path):
    scores = Scores((term("=1+1", [-0.5] * 4),), torch.ones(4))
    write_metrics(tmp_path, replace(report, scores=scores, flags=(Flag(0, "@a"),)))
    head, first = (tmp_path / "metrics.csv").read_text().splitlines()[:2]
    assert head == "frame,time,'=1+1,total,flags"
    assert first == "0,0.0,-0.5,1.0,'@a"


def test_the_table_is_markdown_when_piped_and_drawn_in_a_terminal(report):
    piped, drawn = metrics_table(report, terminal=False), metrics_table(report, terminal=True)
    assert piped.splitlines()[2] == "| shot_size | 0.0200 | frame | 0.0400 | 4/4 | 0.200 | 10.0× |"
    cells = ["shot_size", "0.0200", "frame", "0.0400", "4/4", "0.200", "10.0×"]
    assert cells in [line.split() for line in drawn.splitlines()]


@pytest.mark.parametrize("columns", [80, 200])
def test_a_terminal_shows_the_table_as_it_was_drawn(report, columns, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(columns))
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    show({}, metrics_table(report), as_json=False)
    lines = capsys.readouterr().out.splitlines()
    assert not any("\\x1b" in line or "\x1b" in line for line in lines)
    assert max(map(len, lines)) <= columns
    assert [line.split(" ")[0] for line in lines[-8:-5]] == ["shot_size", "camera_movement", "total"]


@pytest.mark.parametrize("columns", [40, 56, 62, 72, 80, 100])
def test_a_narrow_terminal_cuts_no_number(report, columns, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(columns))
    drawn = metrics_table(report, terminal=True).partition("\n\n")[0]
    assert "…" not in drawn
    markdown = drawn.startswith("| metric |")
    assert markdown == (columns < 60)  # there is no room for seven columns
    assert markdown or max(map(len, drawn.splitlines())) <= columns
    shown = drawn.replace("|", " ").split()
    for row in rows(report):
        assert set(row.cells()[3:]) <= set(shown)


def test_a_long_unit_goes_on_below_before_a_name_is_broken(report, monkeypatch):
    monkeypatch.setenv("COLUMNS", "70")
    long = Term("camera_movement", "frame widths a frame", 1.0, torch.tensor([0.25] * 4))
    drawn = metrics_table(replace(report, scores=Scores((long,), torch.ones(4))), terminal=True).splitlines()
    at = next(i for i, line in enumerate(drawn) if line.startswith("camera_movement"))
    assert [line.split() for line in drawn[at : at + 2]] == [
        ["camera_movement", "0.250", "frame", "widths", "0.250", "4/4", "1.00", "4.00×"],
        ["a", "frame"],
    ]


def test_columns_that_nothing_fills_are_left_out(report):
    alone = replace(report, baseline=None)
    piped, drawn = metrics_table(alone, terminal=False), metrics_table(alone, terminal=True)
    assert piped.splitlines()[0] == "| metric | mean | unit | weighted | coverage |"
    assert piped.splitlines()[2] == "| shot_size | 0.0200 | frame | 0.0400 | 4/4 |"
    for said in (piped, drawn, page(alone)):
        assert "first view" not in said
        assert "/ mean" not in said
    assert page(alone).count("<th>") == 5
    assert page(report).count("<th>") == 7


@pytest.mark.parametrize("terminal", [False, True])
def test_what_the_columns_of_the_first_view_say_stands_below_them(report, terminal):
    assert metrics_table(report, terminal).endswith(f"\n\n{FIRST_VIEW}")
    assert "last column" not in metrics_table(replace(report, baseline=None), terminal)


def test_columns_that_do_not_add_up_say_why(report):
    weighted = "weighted: mean over the frames that have the term; total: mean over all frames"
    assert metrics_table(report, terminal=False).splitlines()[-4] == weighted
    lost = replace(report, scores=replace(report.scores, totals=report.scores.totals + torch.tensor([9.0, 0, 0, 0])))
    price = ", where only the render lacks a term it costs its penalty"
    for said in (metrics_table(lost, terminal=False), metrics_table(lost, terminal=True), page(lost)):
        assert weighted + price in said
    whole = (term("framing", [1.0, 2.0, 3.0, 4.0]), term("shot_size", [0.5] * 4))
    assert sums(replace(report, scores=Scores(whole, torch.tensor([3.0, 5.0, 7.0, 9.0])))) == ""
