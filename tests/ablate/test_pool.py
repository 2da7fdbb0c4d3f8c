"""Workers of a sweep."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from cltransfer.ablate import pool
from cltransfer.ablate.sweep import EngineConfig


def test_workers_import_nothing_from_the_folder_that_a_sweep_is_started_in(
    planted: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pool, "run_trial", lambda trial, job: trial)  # whatever it is: a real one imports torch
    asked: Any = [SimpleNamespace(key="a"), SimpleNamespace(key="b")]
    job: Any = None
    found = [outcome.key for outcome in pool.outcomes(asked, job, EngineConfig(workers=2))]
    assert not planted.exists()
    assert sorted(found) == ["a", "b"]
