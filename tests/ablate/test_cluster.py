"""The same sweep on a dask cluster, a worker of which or whose scheduler is killed in the middle."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cltransfer.ablate.read import read_sweep
from cltransfer.ablate.run import Options, ablate
from cltransfer.ablate.trial import Job, run_trial, trials
from cltransfer.errors import ResourceError

distributed = pytest.importorskip("distributed", reason="needs the extra cltransfer[cluster]")

ROWS = "{full: {}, raises: {losses: {fatal: {}}}}"


def read_lines(folder: Path) -> list[dict[str, Any]]:
    """Lines of the ledger."""
    return [json.loads(line) for line in (folder / "trials.jsonl").read_text().splitlines()]


def test_every_trial_is_there_once_though_a_worker_was_killed(
    sweep_file: Callable[..., Path], fatal: Path, tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CLTRANSFER_CACHE", str(cache))
    file = sweep_file(ROWS, "seeds: [0, 1]")
    out = tmp_path / "out"
    from cltransfer.plugins import allow

    allow([fatal])
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:
        sweep = read_sweep(str(file), ["engine.backend=dask", f"engine.address={cluster.scheduler_address}"])
        killed: list[int] = []

        def progress(step: str, done: int, total: int) -> None:
            assert total == 4
            if done == 2 and not killed:
                killed.append(cluster.workers[0].process.pid)
                os.kill(killed[0], signal.SIGKILL)

        found = ablate(sweep, Options(out, plugins=(str(fatal),)), progress)
    assert len(killed) == 1
    lines = read_lines(out)
    assert len({line["key"] for line in lines}) == len(lines) == len(found.outcomes) == 4
    assert [o.row for o in found.outcomes if o.failed] == ["raises"] * 2
    here = run_trial(trials(sweep, {})[0], Job())
    there = found.outcomes[0]
    assert replace(here, seconds=0, commit="") == replace(there, seconds=0, commit="")


def test_who_shares_a_worker_with_a_trial_that_kills_it_is_run_again(
    sweep_file: Callable[..., Path], fatal: Path, tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import dask

    monkeypatch.setenv("CLTRANSFER_CACHE", str(cache))
    from cltransfer.plugins import allow

    allow([fatal])
    rows = "{full: {}, kills: {losses: {fatal: {how: kill}}}}"
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=2, processes=True, dashboard_address=None, silence_logs=50
        ) as cluster,
    ):
        words = ["engine.backend=dask", f"engine.address={cluster.scheduler_address}"]
        found = ablate(read_sweep(str(sweep_file(rows)), words), Options(tmp_path / "out", plugins=(str(fatal),)))
    assert {o.row: o.failed for o in found.outcomes} == {"full": "", "kills": "its process was killed (out of memory?)"}


@pytest.fixture
def cluster() -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """Address and process of a scheduler with one worker, neither a child of the other."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", address, "--no-dashboard"]
    scheduler = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    command = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads=1", "--no-nanny"]
    worker = subprocess.Popen([*command, "--no-dashboard"], stderr=subprocess.DEVNULL)
    yield address, scheduler
    for process in (worker, scheduler):
        process.kill()
        process.wait()


@pytest.mark.slow  # above a worker is, and the ledger is as whole
def test_a_scheduler_that_is_lost_is_one_line_and_what_was_done_is_kept(
    cluster: tuple[str, subprocess.Popen[bytes]], sweep_file: Callable[..., Path], tmp_path: Path
) -> None:
    address, scheduler = cluster
    out, seeds = tmp_path / "out", "seeds: [0, 1, 2, 3, 4, 5, 6, 7]"
    words = [
        sweep_file("{full: {}}", seeds),
        "--out",
        out,
        "--quiet",
        "engine.backend=dask",
        f"engine.address={address}",
    ]
    command = [sys.executable, "-m", "cltransfer", "ablate", *map(str, words)]
    sweep = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        while sweep.poll() is None and not (out / "trials.jsonl").is_file():
            time.sleep(0.05)
        scheduler.kill()
        told = sweep.communicate(timeout=60)[1]
    finally:
        sweep.kill()
    line = rf"error: {address}: engine.address: the scheduler was lost, \d of 8 trials are left \(start it again; "
    assert re.fullmatch(line + r"the same command goes on from here\)\n", told), told
    assert sweep.returncode == ResourceError.exit_code
    assert read_lines(out)
