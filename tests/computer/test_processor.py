"""What is told of the machine that something was measured on."""

import os

import pytest

from cltransfer.bench.section import machine
from cltransfer.computer.processor import load_average


def test_the_load_is_that_of_five_minutes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "getloadavg", lambda: (9.0, 1.234, 0.5))
    assert load_average() == 1.23
    assert "load average 1.2 while measured" in machine()[0]


def test_a_system_that_counts_no_load_tells_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "getloadavg")
    assert load_average() is None
    assert "load" not in machine()[0]
    assert "load" not in machine([{"load": None, "machine": "mine", "torch": "2"}])[0]
