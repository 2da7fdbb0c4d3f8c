"""Killed at any moment, a run goes on and ends in the same bits."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ARGS = ["builtin:courtyard", "builtin:orbit", "frames=6", "search_side=64", "output_side=96", "threads=1", "-q"]


def start(out: list[str], tmp_path: Path, *more: str) -> subprocess.Popen[str]:
    env = {**os.environ, "CLTRANSFER_CACHE": str(tmp_path / "cache")}
    command = [sys.executable, "-m", "cltransfer", "transfer", *ARGS, *out, *more]
    return subprocess.Popen(command, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize("engine", ["refine", "cma"])
def test_a_killed_run_is_resumed_to_the_same_bits(tmp_path: Path, engine: str) -> None:
    more = (f"engine={engine}", "generations=6")
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    assert start(["--out", str(whole)], tmp_path, *more).wait(120) == 0
    journal = killed / "journal.bin"
    for size in (20_000, 60_000):
        folder = ["--resume", str(killed)] if killed.exists() else ["--out", str(killed)]
        process = start(folder, tmp_path, *more)
        deadline = time.monotonic() + 100
        while process.poll() is None and time.monotonic() < deadline:
            if journal.exists() and journal.stat().st_size > size * (1 if engine == "refine" else 0.2):
                process.send_signal(signal.SIGKILL)
            time.sleep(0.005)
        process.wait(30)
    before = journal.stat().st_size
    assert before > 0
    last = start(["--resume", str(killed)], tmp_path, *more)
    assert last.wait(120) == 0, last.communicate()[1]
    assert (killed / "trajectory.json").read_bytes() == (whole / "trajectory.json").read_bytes()
    assert (killed / "metrics.csv").read_bytes() == (whole / "metrics.csv").read_bytes()
    assert journal.read_bytes() == (whole / "journal.bin").read_bytes()
    spent = [json.loads((run / "metrics.json").read_text())["spent"] for run in (killed, whole)]
    for what in ("evaluations", "renders", "network_passes"):
        assert spent[0][what] == spent[1][what] > (0 if what != "network_passes" else -1)


def test_a_resumed_run_from_another_view_is_refused(tmp_path: Path) -> None:
    assert start(["--out", str(tmp_path / "run")], tmp_path).wait(120) == 0
    view = str(tmp_path / "run" / "trajectory.json")
    process = start(["--resume", str(tmp_path / "run")], tmp_path, "--init", view)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 3
    assert "init: the run was begun with 'auto'" in errors


def test_a_resumed_run_with_another_seed_is_refused_by_name(tmp_path: Path) -> None:
    assert start(["--out", str(tmp_path / "run")], tmp_path).wait(120) == 0
    process = start(["--resume", str(tmp_path / "run")], tmp_path, "seed=5")
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 3
    assert "config.seed: the run was begun with 0, this is 5" in errors
    assert errors.count("\n") == 1
