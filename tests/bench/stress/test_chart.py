"""Charts of the stress bench: what is drawn is what was measured."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from cltransfer.bench.stress.chart import _success, write_success
from cltransfer.bench.stress.verdicts import StressVerdict

SHARES = (1.0, 1.0, 0.9, 0.5, 0.0, 0.0)
VERDICT = StressVerdict("a", "turned_view", SHARES, (1.0,) * 6, 3.0, 1.0, math.nan, 0.0, "")


@pytest.mark.parametrize("beside", [-0.5, 0.0, 0.5])
def test_a_share_is_drawn_as_high_as_it_is(beside: float) -> None:
    ax = Figure().subplots()
    _success(ax, VERDICT, beside, {})
    line = ax.lines[0]
    assert tuple(line.get_ydata()) == SHARES
    assert line.get_xdata() == pytest.approx(range(6), abs=0.2)


def test_lines_on_one_another_are_told_apart() -> None:
    ax = Figure().subplots()
    for beside in (-0.5, 0.0, 0.5):
        _success(ax, VERDICT, beside, {"label": f"{beside}"})
    lines = [line for line in ax.lines if len(line.get_xdata()) == len(SHARES)]
    assert len({line.get_xdata()[0] for line in lines}) == 3
    widths = [line.get_linewidth() for line in lines]
    assert widths == sorted(set(widths), reverse=True)


def test_the_marks_of_a_method_alone_stand_at_their_levels(tmp_path: Path) -> None:
    write_success([VERDICT], tmp_path / "a.svg")
    at = re.findall(r'<use xlink:href="#\w+" x="([\d.]+)"', (tmp_path / "a.svg").read_text())
    assert at[-7:-1] == at[:6]  # the ticks are drawn first; what is drawn last is the mark in the legend
