"""Estimates as text, and what is told of a paired difference in a table's cells."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..paired import Estimate
from .metrics import number

DIFFERENCE = tuple(f"difference_{name}" for name in ("mean", "low", "high", "count", "nonzero", "p"))  # columns of CSV


def signed(difference: Estimate | None) -> str:
    """A difference with the sign that it has, and of how many pairs it is; a dash where there is none."""
    if difference is None or difference.mean is None:
        return "–"
    return f"{interval_text(difference, with_sign)} n={difference.count}"


def with_sign(value: float | None) -> str:
    """A number that has a plus where it is above 0.

    >>> with_sign(0.5), with_sign(-0.5), with_sign(0), with_sign(None)
    ('+0.500', '-0.500', '0', '–')
    """
    return f"+{number(value)}" if value is not None and value > 0 else number(value)


def interval_text(estimate: Estimate, write: Callable[[float | None], str]) -> str:
    """A mean with its interval where there is one, numbers as ``write`` has them."""
    if estimate.low is None:
        return write(estimate.mean)
    return f"{write(estimate.mean)} [{write(estimate.low)}, {write(estimate.high)}]"


def difference_cells(difference: Estimate | None) -> list[Any]:
    """Values under :data:`DIFFERENCE`; empty cells where nothing is compared, as in a first row."""
    if difference is None:
        return [""] * len(DIFFERENCE)
    return [*numbers(difference), difference.nonzero, difference.p]


def numbers(estimate: Estimate) -> list[float | int | None]:
    """Mean, both ends and the count."""
    return [estimate.mean, estimate.low, estimate.high, estimate.count]
