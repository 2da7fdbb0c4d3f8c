"""Charts are drawn as matplotlib comes, not as its user has set it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import pytest

from cltransfer.report.data import ReportData
from cltransfer.report.page import page
from cltransfer.report.svg import svg

SOURCES = Path(svg.__code__.co_filename).parents[1]


@pytest.mark.parametrize(("name", "value"), [("text.usetex", True), ("savefig.bbox", "tight"), ("font.size", 30.0)])
def test_what_the_user_has_set_in_matplotlib_reaches_no_chart(
    report: ReportData, name: str, value: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual = page(report)
    monkeypatch.setenv("PATH", "")  # where LaTeX would be
    monkeypatch.setitem(matplotlib.rcParams, name, value)
    assert page(report) == usual
    assert matplotlib.rcParams[name] == value


def test_every_chart_is_written_in_one_place() -> None:
    writers = [path.name for path in SOURCES.rglob("*.py") if "savefig" in path.read_text(encoding="utf-8")]
    assert writers == ["svg.py"]
