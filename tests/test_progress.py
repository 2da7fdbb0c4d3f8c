"""Progress where there is no terminal: few lines, and none too late; on one: what has ended is told to have."""

from __future__ import annotations

import io
import math
import os
import re
import sys
from collections.abc import Sequence

import pytest

from cltransfer import progress


@pytest.mark.parametrize(("silence", "lines"), [(math.inf, 4), (0.0, 100)])
def test_a_line_for_every_quarter_and_after_silence(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, silence: float, lines: int
) -> None:
    monkeypatch.setattr(progress, "SILENCE", silence)
    with progress.progress(quiet=False) as report:
        for done in range(100):
            report("level 0", done, 100)
    told = capsys.readouterr().err.splitlines()
    assert len(told) == lines
    assert told[0] == "level 0 0/100"


def test_work_goes_on_when_nobody_reads_its_progress_any_more(monkeypatch: pytest.MonkeyPatch) -> None:
    end, start = os.pipe()
    os.close(end)
    told = io.FileIO(start, "w")
    monkeypatch.setattr(sys, "stderr", io.TextIOWrapper(told, write_through=True))
    with progress.progress(quiet=False) as report:
        for done in range(100):
            report("level 0", done, 100)


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def last_shown(reported: Sequence[tuple[str, int, int]], monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, str]]:
    """Steps and how far they are when work has reported so much and ended."""
    for name, value in {"TERM": "xterm", "COLUMNS": "100", "NO_COLOR": "1"}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "stderr", terminal := Terminal())
    with progress.progress(quiet=False) as report:
        for one in reported:
            report(*one)
    frame = terminal.getvalue().rpartition("\x1b[2K")[2]
    return re.findall(r"^(\w+) .*? (\d+/[\d?]+) ", frame, re.MULTILINE)


def test_a_step_of_unknown_length_has_ended_where_another_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    reported = [("reading", 0, 0), ("pruning", 0, 0), ("frames", 3, 4)]
    assert last_shown(reported, monkeypatch) == [("reading", "1/1"), ("pruning", "1/1"), ("frames", "3/4")]
    assert last_shown(reported[:2], monkeypatch) == [("reading", "1/1"), ("pruning", "1/1")]


def test_a_step_of_unknown_length_is_one_line_however_often_it_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    reported = [("reading", 0, 0), ("reading", 0, 0), ("frames", 4, 4), ("reading", 0, 0), ("frames", 2, 4)]
    assert last_shown(reported, monkeypatch) == [("frames", "2/4"), ("reading", "1/1")]


def test_a_step_whose_length_is_known_later_ends_by_it(monkeypatch: pytest.MonkeyPatch) -> None:
    assert last_shown([("reading", 0, 0), ("reading", 2, 5)], monkeypatch) == [("reading", "2/5")]


def test_a_step_in_which_work_breaks_off_has_not_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", terminal := Terminal())

    def work() -> None:
        with progress.progress(quiet=False) as report:
            report("reading", 0, 0)
            raise OSError("gone")

    with pytest.raises(OSError, match="gone"):
        work()
    assert "reading" in terminal.getvalue()
    assert "1/1" not in terminal.getvalue()
