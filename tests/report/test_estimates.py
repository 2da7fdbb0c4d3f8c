"""Estimates in the cells of tables."""

from __future__ import annotations

import pytest

from cltransfer.paired import Estimate, estimate
from cltransfer.report.estimates import DIFFERENCE, difference_cells, signed
from cltransfer.report.metrics import number


def test_a_difference_has_its_sign_its_interval_and_its_pairs() -> None:
    assert signed(Estimate(0.25, 0.125, 0.5, 8, 8, 0.01)) == "+0.250 [+0.125, +0.500] n=8"
    assert signed(estimate([-1.0, -2.0])) == "-1.50 n=2"
    assert (signed(None), signed(estimate([]))) == ("–", "–")
    assert number(0.25) in signed(estimate([0.25]))


@pytest.mark.parametrize("difference", [None, estimate([]), estimate([1.0, 2.0])])
def test_every_column_of_a_difference_has_a_cell(difference: Estimate | None) -> None:
    assert len(difference_cells(difference)) == len(DIFFERENCE)
