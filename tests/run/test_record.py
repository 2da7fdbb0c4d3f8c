"""The journal of a run, and that what lies beside it is not finished."""

from __future__ import annotations

from pathlib import Path

import pytest

from cltransfer.run.record import Record
from cltransfer.storage.run_files import DONE, JOURNAL
from cltransfer.testing.samples import sample_cameras


@pytest.mark.parametrize("header", [{"config.steps": 1}, {"config.steps": 2}])
def test_a_run_that_is_begun_anew_is_not_finished(tmp_path: Path, header: dict[str, int]) -> None:
    Record(tmp_path / JOURNAL).open({"config.steps": 1})
    (tmp_path / DONE).touch()
    record = Record(tmp_path / JOURNAL)
    record.settle(record.open(header))
    assert not (tmp_path / DONE).exists()


def test_a_run_that_is_refused_before_it_settles_leaves_another_as_it_was(tmp_path: Path) -> None:
    cameras = sample_cameras(0, 2)
    Record(tmp_path / JOURNAL).open({"config.steps": 1}).answer(cameras, lambda: cameras.center)
    (tmp_path / DONE).touch()
    before = (tmp_path / JOURNAL).read_bytes()
    record = Record(tmp_path / JOURNAL)
    record.open({"config.steps": 2}).answer(cameras, lambda: cameras.center)
    assert (tmp_path / JOURNAL).read_bytes() == before
    assert (tmp_path / DONE).exists()
    assert not record.ours


def test_a_run_is_known_as_ours_as_soon_as_it_can_go_on(tmp_path: Path) -> None:
    record = Record(tmp_path / JOURNAL)
    assert not record.ours
    record.open({"config.steps": 1})
    assert record.ours  # nothing lay there
    assert Record(tmp_path / JOURNAL, resume=True).ours
    other = Record(tmp_path / JOURNAL)
    journal = other.open({"config.steps": 2})
    assert not other.ours
    other.settle(journal)
    assert other.ours
