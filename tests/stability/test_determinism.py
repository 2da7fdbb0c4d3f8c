"""Same machine, versions, threads and seed: the same bits."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import torch

ENGINES = ("engine=refine", "engine=cma")
SHORT = ("frames=2", "generations=2", "search_side=48", "output_side=96")


@pytest.fixture(scope="module")
def first_run(solve: Callable[..., Any]) -> Callable[[str], Any]:
    """A run by either engine with one thread, after a global seed."""

    @cache
    def run(engine: str) -> Any:
        torch.manual_seed(1)
        return solve("builtin:push_in", engine, *SHORT)

    return run


@pytest.mark.parametrize("engine", ENGINES)
def test_a_second_run_in_one_process_gives_the_same_bits(
    solve: Callable[..., Any], first_run: Callable[[str], Any], engine: str
) -> None:
    first, second = first_run(engine), solve("builtin:push_in", engine, *SHORT)
    assert torch.equal(first.trajectory.camera.w2c, second.trajectory.camera.w2c)
    assert torch.equal(first.trajectory.camera.K, second.trajectory.camera.K)
    assert torch.equal(first.image, second.image)
    assert torch.equal(first.verified.totals, second.verified.totals)


@pytest.mark.parametrize("engine", ENGINES)
def test_two_threads_give_the_bits_of_one(
    solve: Callable[..., Any], first_run: Callable[[str], Any], engine: str
) -> None:
    one, two = first_run(engine), solve("builtin:push_in", engine, *SHORT, "threads=2")
    assert torch.equal(one.trajectory.camera.w2c, two.trajectory.camera.w2c)
    assert torch.equal(one.image, two.image)


def test_a_global_seed_changes_nothing_and_is_not_changed(
    solve: Callable[..., Any], first_run: Callable[[str], Any]
) -> None:
    first = first_run("engine=cma")
    torch.manual_seed(2)
    before = torch.get_rng_state()
    second = solve("builtin:push_in", "engine=cma", *SHORT)
    assert torch.equal(first.trajectory.camera.w2c, second.trajectory.camera.w2c)
    assert torch.equal(before, torch.get_rng_state())


def test_two_processes_leave_the_same_trajectory(tiny_run: Path, tmp_path: Path) -> None:
    """The one of ``tiny_run``, and one with another salt of hashes and a cache of its own."""
    other = tmp_path / "other"
    subprocess.run(
        [sys.executable, "-m", "cltransfer", "transfer", "-q", "-c", tiny_run / "config.yaml", "--out", other],
        env={**os.environ, "CLTRANSFER_CACHE": str(tmp_path / "cache"), "PYTHONHASHSEED": "2"},
        stdout=subprocess.DEVNULL,
        check=True,
        timeout=200,
    )
    assert (tiny_run / "trajectory.json").read_bytes() == (other / "trajectory.json").read_bytes()
    first, second = (json.loads((run / "metrics.json").read_text())["metrics"] for run in (tiny_run, other))
    assert first == second
