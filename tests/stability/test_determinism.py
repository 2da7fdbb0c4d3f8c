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


def same(first: Any, second: Any) -> bool:
    """Whether two runs ended in the same cameras, pictures and totals."""
    ends = [(r.trajectory.camera.w2c, r.trajectory.camera.K, r.image, r.verified.totals) for r in (first, second)]
    return all(torch.equal(one, other) for one, other in zip(*ends))


# by the other engine below, after another global seed
def test_a_second_run_in_one_process_gives_the_same_bits(
    solve: Callable[..., Any], first_run: Callable[[str], Any]
) -> None:
    assert same(first_run("engine=refine"), solve("builtin:push_in", "engine=refine", *SHORT))


@pytest.mark.parametrize("engine", ENGINES)
def test_two_threads_give_the_bits_of_one(
    solve: Callable[..., Any], first_run: Callable[[str], Any], engine: str
) -> None:
    assert same(first_run(engine), solve("builtin:push_in", engine, *SHORT, "threads=2"))


def test_a_global_seed_changes_nothing_and_is_not_changed(
    solve: Callable[..., Any], first_run: Callable[[str], Any]
) -> None:
    first = first_run("engine=cma")
    torch.manual_seed(2)
    before = torch.get_rng_state()
    assert same(first, solve("builtin:push_in", "engine=cma", *SHORT))
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
