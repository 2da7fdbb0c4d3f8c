"""Two methods on the same clips: paired differences with their intervals and tests."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..paired import Estimate, change, estimate


@dataclass(frozen=True)
class Comparison:
    """One metric of a baseline and of ours, over the clips on which both have a value.

    Args:
        name, unit: of the metric.
        baseline, ours: mean with its interval.
        difference: ours minus the baseline's, clip by clip; below 0 is in our favour where lower is better.
        wins: share of clips on which ours is lower.
        p_holm: after Holm's correction over the metrics that are tested together; NaN where none was asked for.
    """

    name: str
    unit: str
    baseline: Estimate
    ours: Estimate
    difference: Estimate
    wins: float
    p_holm: float = math.nan

    @property
    def p(self) -> float:
        """Of the difference by Wilcoxon's two-sided signed-rank test, NaN of fewer than one clip."""
        return math.nan if self.difference.p is None else self.difference.p


def compared(name: str, unit: str, baseline: Sequence[float], ours: Sequence[float]) -> Comparison:
    """Compare values (n,) of the same clips; a clip without a value on either side (NaN) is left out of both."""
    pairs = [(a, b) for a, b in zip(baseline, ours, strict=True) if math.isfinite(a) and math.isfinite(b)]
    first, second = [a for a, _ in pairs], [b for _, b in pairs]
    differences = [change(b, a) for a, b in pairs]
    wins = sum(d < 0 for d in differences) / len(pairs) if pairs else math.nan
    return Comparison(name, unit, estimate(first), estimate(second), estimate(differences), wins)


def holm(p: Sequence[float]) -> list[float]:
    """Holm's step-down correction; NaN stays and counts for nothing (Holm 1979).

    >>> holm([0.01, 0.04, 0.03])
    [0.03, 0.06, 0.06]
    """
    order = sorted((i for i, value in enumerate(p) if math.isfinite(value)), key=lambda i: p[i])
    corrected, highest = [math.nan] * len(p), 0.0
    for rank, i in enumerate(order):
        highest = max(highest, min(1.0, (len(order) - rank) * p[i]))
        corrected[i] = highest
    return corrected


def together(comparisons: Sequence[Comparison]) -> list[Comparison]:
    """The comparisons with Holm's correction over all of them."""
    return [replace(c, p_holm=p) for c, p in zip(comparisons, holm([c.p for c in comparisons]))]
