from __future__ import annotations

import pytest
import torch

from cltransfer.bench.grid_speed import THICKNESS, room_grid, run_grid_speed
from cltransfer.bench.synthetic_room import ROOM
from cltransfer.bench.timing import write_benchmarks


@pytest.fixture(scope="module")
def rows():
    threads = torch.get_num_threads()
    rows = run_grid_speed([0, 1], quick=True)
    assert torch.get_num_threads() == threads
    return rows


@pytest.mark.slow  # tests/bench/test_speed.py has rows of splats
def test_every_row_states_what_was_measured(rows):
    assert [row.setting for row in rows] == [
        "torch, all",
        "numba, all",
        "numba, all",
        "numba, depth + label",
        "numba, all",
    ]
    for row in rows:
        low, median, high = row.milliseconds
        assert 0 < low <= median <= high
        assert 0 < row.counts[0] < 1
    assert {row.threads for row in rows} == {1, 2}


@pytest.mark.slow  # tests/bench/test_speed.py has rows of splats
def test_speed_and_accuracy_against_the_oracle_stand_in_one_row(rows):
    (compared,) = [row for row in rows if row.speedup is not None]
    assert compared.accuracy < 1e-3
    assert compared.speedup == pytest.approx(rows[0].milliseconds[1] / compared.milliseconds[1])
    assert compared.speedup > 1  # a bench, not a timed test: the page has the figure


def test_the_room_has_matter_on_its_walls_and_a_labelled_figure():
    grid = room_grid(64, 0, seed=0)
    matter = grid.density > 0
    assert grid.density.max() * float(grid.voxel.min()) == pytest.approx(THICKNESS, rel=1e-5)
    means = grid.means
    assert (means.amin(0) < 0.2).all()
    assert (means.amax(0) > torch.from_numpy(ROOM) - 0.2).all()
    assert 0 < (grid.label[matter] > 0).float().mean() < 0.2


@pytest.mark.slow  # tests/bench/test_speed.py has rows of splats
def test_the_section_is_written(rows, tmp_path):
    write_benchmarks(rows, tmp_path / "benchmarks.md", "bench grid")
    text = (tmp_path / "benchmarks.md").read_text()
    assert "## Voxel grid rendering" in text
    assert text.count("| room 32^3, degree 0 | 160x90 |") == len(rows)
