"""A level is trained by one process, wherever it runs."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from cltransfer.fit._views import Views
from cltransfer.fit.nerf_grid import NerfGridFit

OPTIONS = NerfGridFit(first=200, most=200, steps=9, look=3, rays=64, degree=0)


class Stop(Exception):
    """What interrupts a fit."""


@pytest.mark.parametrize("tasks", ["1", "4"])
def test_a_job_of_slurm_trains_alone_and_puts_itself_in_no_queue(
    views: Views, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tasks: str
) -> None:
    handlers: set[object] = set()

    def look(step: str, done: int, total: int) -> None:
        handlers.add(signal.getsignal(signal.SIGUSR1))
        if done == 5:
            raise Stop

    job = {"JOB_ID": "1", "JOB_NAME": "fit", "NTASKS": tasks, "PROCID": "3", "LOCALID": "3", "NODEID": "0"}
    for name, value in job.items():
        monkeypatch.setenv(f"SLURM_{name}", value)
    before = signal.getsignal(signal.SIGUSR1)
    with pytest.raises(Stop):
        OPTIONS.fit(views, tmp_path, look)
    assert handlers == {before}
    assert (tmp_path / "level_0.safetensors").is_file()
    (level,) = OPTIONS.fit(views, tmp_path, lambda *step: None)
    assert level.steps == 9
