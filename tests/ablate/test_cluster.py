"""The same sweep on a dask cluster, one worker of which is killed in the middle."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from cltransfer.ablate.read import read_sweep
from cltransfer.ablate.run import Options, ablate
from cltransfer.ablate.trial import Job, run_trial, trials

distributed = pytest.importorskip("distributed", reason="needs the extra cltransfer[cluster]")

ROWS = "{full: {}, raises: {losses: {fatal: {}}}}"


def test_every_trial_is_there_once_though_a_worker_was_killed(
    sweep_file: Callable[..., Path], fatal: Path, tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CLTRANSFER_CACHE", str(cache))
    file = sweep_file(ROWS, "seeds: [0, 1, 2]")
    out = tmp_path / "out"
    from cltransfer.plugins import allow

    allow([fatal])
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:
        sweep = read_sweep(str(file), ["engine.backend=dask", f"engine.address={cluster.scheduler_address}"])
        killed: list[int] = []

        def progress(step: str, done: int, total: int) -> None:
            assert total == 6
            if done == 2 and not killed:
                killed.append(cluster.workers[0].process.pid)
                os.kill(killed[0], signal.SIGKILL)

        found = ablate(sweep, Options(out, plugins=(str(fatal),)), progress)
    assert len(killed) == 1
    lines = [json.loads(line) for line in (out / "trials.jsonl").read_text().splitlines()]
    assert len({line["key"] for line in lines}) == len(lines) == len(found.outcomes) == 6
    assert [o.row for o in found.outcomes if o.failed] == ["raises"] * 3
    here = run_trial(trials(sweep, {})[0], Job())
    there = found.outcomes[0]
    assert replace(here, seconds=0, commit="") == replace(there, seconds=0, commit="")
