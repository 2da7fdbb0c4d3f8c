"""The CSV of the driver's bench."""

from __future__ import annotations

import math

from cltransfer.bench.driver import Clip
from cltransfer.bench.driver_chart import driver_csv


def test_what_is_not_defined_is_an_empty_cell() -> None:
    clip = Clip("fast", "cross", "pan", 3, 0.25, 2 / 3, 12.0, 7.0, math.nan, math.nan, math.nan, -0.3, 0.1, 0.1, 0.0)
    header, line = driver_csv([clip]).splitlines()
    assert header.split(",")[:5] == ["preset", "target", "shot", "seed", "total"]
    assert line == "fast,cross,pan,3,0.25,0.666667,12,7,,,,-0.3,0.1,0.1,0"
