"""Table 1 on the smoke tier, end to end, and its arithmetic on rows that are given."""

import csv
import json
import time
from dataclasses import replace

import pytest
from typer.testing import CliRunner

from cltransfer.bench.compare import compared
from cltransfer.bench.measures import SIDE_MEASURES, failed_frames, paired, term
from cltransfer.bench.methods import TERMS
from cltransfer.bench.protocol import TIERS
from cltransfer.bench.rows import read_rows
from cltransfer.bench.table1 import comparison_table, duel, latex, markdown, write_table1
from cltransfer.bench.verbs import app
from cltransfer.registry import LOSSES

SMOKE = 60.0  # seconds of one core that the smoke tier may take on a usual machine


def _row(method, value, failed=(), shot="pan", **more):
    terms = {name: [value, value, 3 * value] for name in TERMS}
    printed = {name: [None, value / 2, value] for name in TERMS}
    row = {
        "method": method,
        **{"shot": shot, "teacher": "room-0", "pupil": "stage-1", "seed": 1, "frames": 3, "options": []},
        **{"priced": terms, "faithful": printed, "held_out": {"dis_flow": {"camera_movement": [None, value, value]}}},
        **{"failed": {"joints": list(failed)} if failed else {}, "failed_clip": bool(failed)},
        **{"total": value, "jerk": 0.2, "reference_jerk": 0.1, "scale_agreement": 1.0},
        **{"evaluations": 10.0, "seconds": 1.0, "commit": "abc"},
        "truth": dict.fromkeys(("position", "rotation", "log_focal", "path_position", "path_rotation"), value),
    }
    return {**row, **more}


def test_the_page_tells_the_load_that_its_rows_were_measured_under(tmp_path, monkeypatch):
    monkeypatch.setattr("os.getloadavg", lambda: (0.0, 1.7, 0.0))
    write_table1([_row("new", 1.0, load=3.7)], [], tmp_path, None, "cltransfer bench table1")
    assert "load average 3.7 while measured;" in (tmp_path / "table1.md").read_text()


@pytest.mark.parametrize("fails", ["old", "new"])
def test_frames_that_failed_by_either_method_are_left_out_of_both(fails):
    failed = {fails: [2]}  # a frame of a clip that has not
    rows = [_row(name, v, failed.get(name, ()), failed_clip=False) for name, v in (("old", 2.0), ("new", 1.0))]
    found = duel(rows, "old", "new", "cross")
    assert found.all_frames[0].baseline.mean == pytest.approx(10 / 3)
    assert found.all_frames[0].ours.mean == pytest.approx(5 / 3)
    for sound in (found.sound_frames, found.sound_clips):
        assert sound[0].baseline.mean == pytest.approx(2.0)
        assert sound[0].ours.mean == pytest.approx(1.0)


def test_a_clip_of_failed_frames_alone_is_left_out_and_counted():
    rows = [
        _row("old", 2.0, failed=[0, 1, 2]),
        _row("new", 1.0),
        _row("old", 2.0, shot="tilt"),
        _row("new", 1.0, shot="tilt"),
    ]
    found = duel(rows, "old", "new", "cross")
    assert found.all_frames[0].difference.count == 2
    assert found.sound_frames[0].difference.count == 1
    rates = {c.name: c for c in found.beside}
    assert rates["failed clips"].baseline.mean == 0.5
    assert rates["failed frames"].baseline.mean == 0.5


def test_a_clip_that_failed_is_left_out_whole_of_the_sound_ones():
    rows = [_row("old", 2.0, failed_clip=True), _row("new", 1.0)]  # no frame of it failed by itself
    rows += [_row("old", 4.0, shot="tilt"), _row("new", 1.0, shot="tilt")]
    found = duel(rows, "old", "new", "cross")
    assert found.sound_frames[0].difference.count == 2
    assert found.sound_clips[0].difference.count == 1
    assert found.sound_clips[0].baseline.mean == pytest.approx(20 / 3)


def test_rows_are_paired_by_their_clip_alone():
    rows = [_row("old", 2.0), _row("new", 1.0, shot="tilt"), _row("new", 3.0)]
    assert [(a["total"], b["total"]) for a, b in paired(rows, "old", "new")] == [(2.0, 3.0)]


def test_bold_is_what_is_certain_by_the_corrected_p_where_there_is_one():
    old, new = [1.0] * 8, [0.5, 0.6, 0.7, 0.4, 0.8, 0.3, 0.2, 0.1]
    sure = compared("sure", "m", old, new)
    assert sure.difference.certain
    assert comparison_table([sure], "old", "new").bold == {(0, 4)}
    assert comparison_table([replace(sure, p_holm=0.04)], "old", "new").bold == {(0, 4)}
    assert not comparison_table([replace(sure, p_holm=0.06)], "old", "new").bold


def test_every_measure_has_the_unit_of_its_loss():
    for name in TERMS:
        printed = LOSSES.build(name, {"mode": "faithful"}).unit
        assert SIDE_MEASURES[f"{name}, as printed"][0].startswith(printed)
        assert SIDE_MEASURES.get(f"{name} by networks", (printed,))[0] == printed
    assert [name for name, (unit, _) in SIDE_MEASURES.items() if not unit] == ["evaluations a frame", "seconds a clip"]


def test_what_was_not_read_is_no_line():
    rows = [_row("old", 2.0), _row("new", 1.0)]
    assert not [c.name for c in duel(rows, "old", "new", "cross").beside if "networks" in c.name]


def test_an_undefined_frame_of_the_reference_counts_for_nothing():
    row = _row("old", 1.0)
    row["priced"]["framing"] = [None, 1.0, 2.0]
    assert term(row, "framing") == pytest.approx(1.5)


def test_the_smoke_tier_measures_jaws_against_ours(tmp_path, within):
    tier, folder, page = TIERS["smoke"], tmp_path / "rows", tmp_path / "benchmarks.md"
    arguments = ["table1", "--tier", "smoke", "--rows", str(folder), "--out", str(page)]
    begun = time.process_time()
    ran = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert within(time.process_time() - begun, SMOKE)
    assert ran.exit_code == 0
    rows = list(read_rows(folder).values())
    assert sorted({(row["method"], row["shot"]) for row in rows}) == [
        (method, shot) for method in ("balanced", "jaws_clean") for shot in sorted(tier.shots)
    ]
    assert all(row["frames"] == tier.frames and row["evaluations"] > 5 for row in rows)
    lines = list(csv.DictReader((folder / "table1.csv").read_text().splitlines()))
    means = {line["metric"]: line for line in lines if line["frames"] == "all"}
    assert set(TERMS) < set(means)
    of_ours = [term(row, "framing") for row in rows if row["method"] == "balanced"]
    assert float(means["framing"]["ours_mean"]) == pytest.approx(sum(of_ours) / len(tier.shots))
    assert "## Table 1" in page.read_text()
    assert "Budgets are cut" in page.read_text()
    assert (folder / "table1.tex").read_text().count(r"\begin{tabular}") == 1
    for row in rows:
        assert failed_frames(row) == {i for i in range(tier.frames) if any(i in of for of in row["failed"].values())}
        assert json.loads((folder / "paths" / f"{row['key']}.json").read_text())["size"] == [160, 90]


def test_text_for_people_and_for_papers():
    found = [duel([_row("old", 2.0), _row("new_one", 1.0)], "old", "new_one", "self")]
    assert "### new_one against old, within a scene (true cameras known)" in markdown(found)
    assert r"new\_one" in "\n".join(latex(found))
