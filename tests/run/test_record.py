"""The journal of a run, and that what lies beside it is not finished."""

from __future__ import annotations

from pathlib import Path

import pytest

from cltransfer.run.record import Record
from cltransfer.storage.run_files import DONE, JOURNAL


@pytest.mark.parametrize("header", [{"config.steps": 1}, {"config.steps": 2}])
def test_a_run_that_is_begun_anew_is_not_finished(tmp_path: Path, header: dict[str, int]) -> None:
    Record(tmp_path / JOURNAL).open({"config.steps": 1})
    (tmp_path / DONE).touch()
    Record(tmp_path / JOURNAL).open(header)
    assert not (tmp_path / DONE).exists()
