from __future__ import annotations

import statistics
import time
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from cltransfer.bench.pages import SECTIONS, markers
from cltransfer.bench.speed import BENCH, _second_process, run_speed
from cltransfer.bench.synthetic_room import room_cameras, synthetic_room
from cltransfer.bench.timing import SpeedRow, write_benchmarks
from cltransfer.renderers.gaussian_splats import GaussianSplats
from cltransfer.scenes import Scene
from cltransfer.scenes.ply import write_splats

BEGIN, END = markers(SECTIONS["speed"])
ROW = SpeedRow(BENCH, "room", (160, 90), "numba, all", 1, (10_000, 5_000), (1.0, 2.0, 3.0), 40.0, 90.0)


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    path = tmp_path_factory.mktemp("scenes") / "stage.ply"
    write_splats(path, synthetic_room(1000))
    threads = torch.get_num_threads()
    rows = run_speed([0, 1], [path], quick=True)
    assert torch.get_num_threads() == threads
    return rows


def test_every_row_states_what_was_measured(rows):
    assert [row.scene for row in rows] == ["room 2k"] * 7 + ["stage"] * 5 + ["second process"]
    for row in rows:
        low, median, high = row.milliseconds
        assert 0 < low <= median <= high
        assert 0 < row.counts[1] <= row.counts[0]
    assert {row.threads for row in rows} == {1, 2}


@pytest.mark.slow  # three processes
def test_a_second_process_imports_nothing_from_the_folder_that_it_is_started_in(planted):
    assert _second_process(2).counts[0] == 10_000
    assert not planted.exists()


def test_speed_and_accuracy_against_the_oracle_stand_in_one_row(rows):
    compared = [row for row in rows if row.speedup is not None]
    assert len(compared) == 1
    assert compared[0].accuracy >= 60
    assert compared[0].speedup == pytest.approx(rows[0].milliseconds[1] / compared[0].milliseconds[1])
    assert compared[0].speedup > 1  # a bench, not a timed test: the page has the figure


def test_depth_and_label_alone_cost_less_than_all_buffers():
    scene = Scene(synthetic_room(10_000), None, torch.tensor([0.0, 0, 1]), "room", "0" * 64)
    cameras, renderer = room_cameras(4, (160, 90)), GaussianSplats(threads=1)

    def seconds(buffers):
        start = time.thread_time()
        renderer.render(scene, cameras, buffers)
        return time.thread_time() - start

    pairs = [(seconds(renderer.provides), seconds(frozenset({"depth", "label"}))) for _ in range(16)][1:]
    assert statistics.median(lean / full for full, lean in pairs) < 0.95


def test_the_section_is_replaced_and_the_rest_of_the_page_kept(tmp_path):
    page = tmp_path / "benchmarks.md"
    page.write_text("# Benchmarks\n\n## Losses\n\ntable\n")
    write_benchmarks([ROW, ROW], page, "bench speed")
    first = page.read_text()
    assert first.startswith("# Benchmarks\n\n## Losses\n\ntable\n\n## Splat rendering\n\n" + BEGIN)
    page.write_text(first + "\n## After\n")
    write_benchmarks([replace(ROW, scene="lawn")], page, "bench speed")
    second = page.read_text()
    assert second.count(BEGIN) == second.count(END) == second.count("## Splat rendering") == 1
    assert second.startswith("# Benchmarks\n\n## Losses\n\ntable\n")
    assert second.endswith("\n## After\n")
    assert "| lawn | 160x90 | numba, all | 1 | 10,000 | 5,000 | 2.0 (1.0-3.0) | 40x | 90 dB |" in second
    assert "| room |" not in second


def test_a_new_page_gets_a_title(tmp_path):
    write_benchmarks([ROW], tmp_path / "docs" / "benchmarks.md", "bench speed")
    text = Path(tmp_path / "docs" / "benchmarks.md").read_text()
    assert text.startswith("# Benchmarks\n\n## Splat rendering\n")
    assert "commit " in text
