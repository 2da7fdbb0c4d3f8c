"""The CSV of the driver's bench."""

import math

from cltransfer.bench.driver_chart import _cell


def test_what_is_not_defined_is_an_empty_cell() -> None:
    assert [_cell(value) for value in ("fast", 3, 0.25, math.nan)] == ["fast", "3", "0.25", ""]
