from __future__ import annotations

import shlex

import pytest
import torch

from cltransfer.bench.mesh_speed import BENCH, run_mesh_speed, synthetic_mesh
from cltransfer.bench.pages import SECTIONS, markers
from cltransfer.bench.timing import SpeedRow, write_benchmarks

ROW = SpeedRow(BENCH, "room", (160, 90), "numba, all", 1, (10_000,), (1.0, 2.0, 3.0), 28.4, 99.996)


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    path = tmp_path_factory.mktemp("scenes") / "stage.obj"
    path.write_text("v -1 0 0\nv 1 0 0\nv 0 2 0\nv 0 1 1\nf 1 2 3\nf 1 2 4\n")
    threads = torch.get_num_threads()
    rows = run_mesh_speed([0], [path], quick=True)
    assert torch.get_num_threads() == threads
    return rows


def test_every_row_states_what_was_measured(rows):
    assert [row.scene for row in rows] == ["room 2k"] * 5 + ["stage"] * 3
    for row in rows:
        low, median, high = row.milliseconds
        assert 0 < low <= median <= high
    assert rows[-1].counts == (2,)


def test_speed_and_accuracy_against_the_oracle_stand_in_one_row(rows):
    (row,) = [row for row in rows if row.speedup is not None]
    assert row.accuracy >= 99.9
    assert row.speedup == pytest.approx(rows[0].milliseconds[1] / row.milliseconds[1])
    assert row.speedup > 1  # a bench, not a timed test: the page has the figure


def test_the_room_has_about_as_many_faces_as_asked_for():
    for count in (2_000, 20_000):
        assert 0.5 * count < len(synthetic_mesh(count)) < 2.5 * count
    assert 0 < synthetic_mesh(2_000).label.mean() < 0.5


def test_a_page_names_the_command_that_made_it(tmp_path, command):
    words = ("bench", "mesh", "--quick", "--seed", 7, "--out", tmp_path / "page.md")
    said = command(*words)
    assert (said.code, said.err) == (0, "")
    assert f"Made by `cltransfer {shlex.join(map(str, words))}`." in (tmp_path / "page.md").read_text()


def test_the_section_is_rewritten_beside_others(tmp_path):
    page = tmp_path / "benchmarks.md"
    page.write_text("# Benchmarks\n\n## Losses\n\ntable\n")
    write_benchmarks([ROW, ROW], page, "bench mesh")
    write_benchmarks([ROW], page, "bench mesh")
    text = page.read_text()
    begin, end = markers(SECTIONS["mesh"])
    assert text.startswith("# Benchmarks\n\n## Losses\n\ntable\n\n## Mesh rendering\n\n" + begin)
    assert text.count(begin) == text.count(end) == 1
    assert (
        "| scene | size | setting | threads | faces | ms a frame (quartiles) | against torch | depth agrees |" in text
    )
    assert "| room | 160x90 | numba, all | 1 | 10,000 | 2.0 (1.0-3.0) | 28x | 100.00 % |" in text
