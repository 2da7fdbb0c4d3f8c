"""Means with their bootstrap intervals, and what differences of pairs tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean

import numpy as np

CONFIDENCE = 0.95
RESAMPLES = 9999
FEWEST = 6  # values of one sign by chance: 1 in 32; of fewer no test reaches LEVEL, nor says an interval much
ROUNDING = 1e-9  # of what is compared: differences no larger than that are none
LEVEL = 0.05


@dataclass(frozen=True)
class Estimate:
    """A mean and its interval.

    Args:
        mean: None where nothing has a value.
        low, high: percentile bootstrap of the mean, 95 %; None of fewer than :data:`FEWEST`.
        count: values it is the mean of.
        nonzero: how many of them are not 0: of differences those that have a sign.
        p: two-sided Wilcoxon signed-rank test against 0; None of nothing.
    """

    mean: float | None
    low: float | None
    high: float | None
    count: int
    nonzero: int
    p: float | None

    @property
    def certain(self) -> bool:
        """Whether the interval excludes zero and the signed-rank test agrees, of enough values that are not zero.

        Alone a percentile interval of six values excludes zero by chance in 14 % of cases, or 25 where they are skewed.
        """
        if self.low is None or self.high is None or self.p is None:
            return False
        return self.nonzero >= FEWEST and self.p <= LEVEL and (self.low > 0 or self.high < 0)


def estimate(values: Sequence[float]) -> Estimate:
    """Mean of ``values`` with its percentile bootstrap interval; the resampling has a seed of its own.

    Of few values it is too narrow: simulated, it held the mean of normal values in 86 % of cases of 6, 91 of 9 and 94
    of 22, that of log-normal ones in 74, 80 and 87.

    >>> estimate([1.0, 1.0])
    Estimate(mean=1.0, low=None, high=None, count=2, nonzero=2, p=0.5)
    >>> estimate([])
    Estimate(mean=None, low=None, high=None, count=0, nonzero=0, p=None)
    """
    from scipy.stats import bootstrap

    rest = len(values), sum(value != 0 for value in values), wilcoxon_p(values)
    if len(values) < FEWEST:
        return Estimate(fmean(values) if values else None, None, None, *rest)
    generator = np.random.Generator(np.random.PCG64(0))
    found = bootstrap(
        (np.asarray(values),),
        np.mean,
        n_resamples=RESAMPLES,
        confidence_level=CONFIDENCE,
        method="percentile",
        rng=generator,
    )
    interval = found.confidence_interval
    return Estimate(fmean(values), float(interval.low), float(interval.high), *rest)


def wilcoxon_p(differences: Sequence[float]) -> float | None:
    """Two-sided p of the signed-rank test over what differs; 1 where nothing does, None of nothing.

    Pairs without a difference go first (Wilcoxon 1945): among many of them scipy would take the few that are left for
    a large sample.

    >>> wilcoxon_p([-1.0, -2.0, -3.0, -4.0, -5.0, *[0.0] * 20])
    0.0625
    """
    from scipy.stats import wilcoxon

    if len(differences) == 0:
        return None
    values = np.asarray(differences)
    values = values[values != 0]
    if len(values) == 0:
        return 1.0
    relative = values / np.abs(values).max()  # those that rounding alone tells apart have one rank
    return float(wilcoxon(np.round(relative, 9) + np.sign(relative)).pvalue)


def change(value: float, held: float) -> float:
    """``value`` less ``held``, 0 where they differ by rounding alone.

    >>> change(0.1 + 0.2, 0.3), change(2.0, 0.5)
    (0.0, 1.5)
    """
    return 0.0 if abs(value - held) <= ROUNDING * max(abs(value), abs(held)) else value - held
