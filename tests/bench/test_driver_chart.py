"""The CSV and the chart of the driver's bench."""

from __future__ import annotations

import math
from dataclasses import replace

from matplotlib.figure import Figure

from cltransfer.bench.driver import Clip
from cltransfer.bench.driver_chart import _draw, driver_csv

CLIP = Clip("fast", "cross", "pan", 3, 0.25, 2 / 3, 12.0, 7.0, math.nan, math.nan, math.nan, -0.3, 0.1, 0.1, 0.0)


def test_what_is_not_defined_is_an_empty_cell() -> None:
    header, line = driver_csv([CLIP]).splitlines()
    assert header.split(",")[:5] == ["preset", "target", "shot", "seed", "total"]
    assert line == "fast,cross,pan,3,0.25,0.666667,12,7,,,,-0.3,0.1,0.1,0"


def test_a_total_that_is_drawn_higher_than_it_is_is_told() -> None:
    figure = Figure()
    _draw(figure, [CLIP, replace(CLIP, target="self", total=2e-4)])
    across, _, own, _ = figure.axes
    assert across.get_ylabel() == "cross: mean total of a clip"
    assert own.get_ylabel() == "self: mean total of a clip (below 0.001 at 0.001)"
    assert own.collections[0].get_offsets().tolist() == [[12.0, 0.001]]
