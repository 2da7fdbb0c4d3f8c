"""The ledger: outcomes come back as they were, and a line that is none is named."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from cltransfer.ablate.ledger import append, read_ledger
from cltransfer.ablate.outcome import Case, Metric, Outcome
from cltransfer.computer import memory
from cltransfer.errors import InputError, ResourceError

CASE = Case("builtin:courtyard", "builtin:orbit", 3)
DONE = Outcome("k1", "full", CASE, "", {"total": Metric(0.5, "", 4, "")}, 4, 40, 2, 1.5)
FAILED = Outcome("k2", "full", CASE, failed="clip.mp4: no such file")


def test_reads_back_what_was_appended_and_the_last_of_a_key_counts(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    assert read_ledger(path) == {}
    for outcome in (FAILED, DONE):
        append(path, outcome)
    again = Outcome("k2", "full", CASE, "", {"total": Metric(None, "", 0, "no person")}, 4, 40, 2, 1.5)
    append(path, again)
    assert read_ledger(path) == {"k1": DONE, "k2": again}


def test_trials_are_held_against_the_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    append(tmp_path / "trials.jsonl", DONE)
    monkeypatch.setattr(memory, "free_bytes", lambda: 1000)
    with pytest.raises(ResourceError, match=r"trials\.jsonl: memory: values of \d+ bytes of JSON need"):
        read_ledger(tmp_path / "trials.jsonl")


def test_a_loss_may_have_any_value(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    huge = Outcome("k3", "full", CASE, "", {"total": Metric(1e300, "", 4, "")}, 4, 40, 2, 1.5)
    append(path, huge)
    assert read_ledger(path) == {"k3": huge}


@pytest.mark.parametrize("line", ["{", "[]", "3", '{"key": "a"}', '{"key": "a", "row": "b", "case": {}}', "[" * 10**5])
def test_a_damaged_line_is_named(tmp_path: Path, line: str) -> None:
    path = tmp_path / "trials.jsonl"
    append(path, DONE)
    with path.open("a") as stream:
        stream.write(line + "\n")
    with pytest.raises(InputError, match="line 2: is no trial"):
        read_ledger(path)


VALUES: dict[str, list[Any]] = {
    "frames": [0, -2, "3", True],
    "seconds": [math.nan, math.inf, None],
    "evaluations": ["x", -1],
    "metrics": [None],
}


@pytest.mark.parametrize(("field", "value"), [(field, value) for field, values in VALUES.items() for value in values])
def test_a_value_that_cannot_be_is_named_with_its_line(tmp_path: Path, field: str, value: Any) -> None:
    path = tmp_path / "trials.jsonl"
    append(path, DONE)
    path.write_text(json.dumps({**json.loads(path.read_text()), field: value}) + "\n")
    with pytest.raises(InputError, match="line 1"):
        read_ledger(path)


@pytest.mark.parametrize("mean", [math.nan, math.inf, "0.5", 10**400])
def test_a_mean_that_cannot_be_is_named_with_its_line(tmp_path: Path, mean: Any) -> None:
    path = tmp_path / "trials.jsonl"
    append(path, DONE)
    line = json.loads(path.read_text())
    line["metrics"]["total"]["mean"] = mean
    path.write_text(json.dumps(line) + "\n")
    with pytest.raises(InputError, match="line 1"):
        read_ledger(path)


@pytest.mark.parametrize(("field", "value"), [("scene", [{}]), ("reference", 3), ("seed", "3"), ("seed", True)])
def test_a_case_that_cannot_be_is_named_with_its_line(tmp_path: Path, field: str, value: Any) -> None:
    path = tmp_path / "trials.jsonl"
    append(path, FAILED)
    line = json.loads(path.read_text())
    line["case"][field] = value
    path.write_text(json.dumps(line) + "\n")
    with pytest.raises(InputError, match="line 1: is no trial"):
        read_ledger(path)
