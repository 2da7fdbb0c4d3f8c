"""Sweeps of trials that take a second each."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from cltransfer.ablate import pool
from cltransfer.ablate.trial import run_trial
from cltransfer.registry import LOSSES

TINY = "{preset: fast, frames: 2, search_side: 32, output_side: 48, steps: 1}"
PLUGIN = """
import os, signal
from dataclasses import dataclass
from cltransfer.registry import LOSSES

@LOSSES.register("fatal")
@dataclass(frozen=True)
class Fatal:
    how: str = "raise"
    weight: float = 1.0
    requires, unit, penalty = ("keypoints",), "frame", 1.0
    def __call__(self, reference, rendered):
        if self.how == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        raise ArithmeticError("the loss has no answer")
"""


@pytest.fixture
def sweep_file(tmp_path: Path) -> Callable[..., Path]:
    """An ablation file with ``rows`` on built-in scenes, ``more`` below it."""

    def write(rows: str, more: str = "") -> Path:
        path = tmp_path / "tiny.yaml"
        path.write_text(f"about: tiny\nreferences: ['builtin:static']\nbase: {TINY}\nrows: {rows}\n{more}")
        return path

    return write


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Trials of a sweep are run here, one after the other: processes of their own take longer to start than they do."""
    monkeypatch.setattr(pool, "_by_processes", lambda trials, job, workers: (run_trial(t, job) for t in trials))


@pytest.fixture
def fatal(tmp_path: Path) -> Iterator[Path]:
    """A plugin whose loss raises, or kills its process; it is forgotten after the test."""
    path = tmp_path / "fatal.py"
    path.write_text(PLUGIN)
    yield path
    LOSSES._classes.pop("fatal", None)
