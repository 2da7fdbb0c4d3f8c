"""Progress where there is no terminal: few lines, and none too late."""

from __future__ import annotations

import io
import math
import os
import sys

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
