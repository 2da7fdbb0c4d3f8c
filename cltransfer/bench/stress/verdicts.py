"""What stressed trials come to: success by level, the breakdown point, the tail, the spread, the growth, the cause."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean, quantiles

from ..failure import RANDOM_SHARE
from ..trial import Row
from .trial import STRESSORS

LEVELS = 6  # none and five
GROWN = 0.01  # weighted, 0.2 is a tolerance: a term that has grown less has not
HEADER = (
    "stressor", "method", "success by level, none first", "area", "mean total by level", "breakdown", "worst tenth",
    "spread over clips", "growth along the clip", "grew most",
)  # fmt: skip
SHARES = (
    RANDOM_SHARE,
    0.4,
    0.3,
    0.25,
    0.2,
    0.15,
    0.1,
)  # of what random views have, above which a total counts as failed
STRICTER_HEADER = (
    "failed above", "against", "breaks later", "of these without stress", "same", "breaks earlier", "never breaks",
)  # fmt: skip


@dataclass(frozen=True)
class StressVerdict:
    """One method under one stressor.

    Args:
        method, stressor: which.
        success: share of clips that did not fail, by level, none first.
        totals: mean total by level, none first.
        breakdown: level at which success falls to a half, between levels on the line; None if it never does.
        worst_tenth: mean total of the worst tenth of all stressed clips, at least one.
        spread: distance of the quartiles of the total over clips and seeds, mean over the levels; NaN for one clip.
        growth: mean total of the last third of the frames less that of the first, over stressed clips.
        grown: the weighted term that has grown most at the breakdown, or at the last level, against none; empty where
            none has grown.
    """

    method: str
    stressor: str
    success: tuple[float, ...]
    totals: tuple[float, ...]
    breakdown: float | None
    worst_tenth: float
    spread: float
    growth: float
    grown: str

    @property
    def area(self) -> float:
        """Area under the curve of success against level: mean over the five levels."""
        return fmean(self.success[1:])


def verdicts(rows: Sequence[Row]) -> list[StressVerdict]:
    """One for each stressor and method of ``rows``; rows without stress serve every stressor."""
    found = []
    for stressor in dict.fromkeys(row["stressor"] for row in rows if row["stressor"]):
        for method in dict.fromkeys(row["method"] for row in rows):
            own = [row for row in rows if row["method"] == method]
            frames = {row["frames"] for row in own if row["stressor"] == stressor}
            mine = [row for row in own if row["stressor"] in ("", stressor) and row["frames"] in frames]
            by_level = [[row for row in mine if row["level"] == level] for level in range(LEVELS)]
            if all(by_level):
                found.append(_verdict(method, stressor, by_level))
    return found


def stricter(rows: Sequence[Row], method: str) -> list[list[str]]:
    """Rows under :data:`STRICTER_HEADER`: how ``method`` compares where a clip fails at a lower total already.

    A definition decides what breaks; this tells how much hangs on it. The first share is the definition itself. Of what
    breaks without stress, stress tells nothing: so many of those than which ``method`` breaks later are told too.
    """
    told = []
    for share in SHARES:
        failed = [{**row, "failed": row["failed"] or not row["total"] <= share * row["random_total"]} for row in rows]
        by_key = {(verdict.stressor, verdict.method): verdict.breakdown for verdict in verdicts(failed)}
        broken = {key: math.inf if level is None else level for key, level in by_key.items()}
        stressors = dict.fromkeys(stressor for stressor, _ in broken)
        unbroken = sum(broken[stressor, method] == math.inf for stressor in stressors)
        for other in dict.fromkeys(name for _, name in broken if name != method):
            pairs = [(broken[stressor, method], broken[stressor, other]) for stressor in stressors]
            later, unstressed = sum(a > b for a, b in pairs), sum(a > b == 0 for a, b in pairs)
            counts = [later, unstressed, sum(a == b for a, b in pairs), sum(a < b for a, b in pairs)]
            told.append([f"{100 * share:.0f} % of random", other, *map(str, counts), f"{unbroken} of {len(pairs)}"])
    return told


def _verdict(method: str, stressor: str, by_level: Sequence[Sequence[Row]]) -> StressVerdict:
    success = tuple(1 - fmean(row["failed"] for row in rows) for rows in by_level)
    breakdown = breakdown_point(success)
    stressed = [row for rows in by_level[1:] for row in rows]
    totals = sorted((row["total"] for row in stressed), reverse=True)
    worst = totals[: max(1, round(len(totals) / 10))]
    broken = LEVELS - 1 if breakdown is None else max(1, math.ceil(breakdown))
    return StressVerdict(
        method,
        stressor,
        success,
        tuple(fmean(row["total"] for row in rows) for rows in by_level),
        breakdown,
        fmean(worst),
        fmean(_spread([row["total"] for row in rows]) for rows in by_level[1:]),
        fmean(_growth(row["totals"]) for row in stressed),
        _grown_most(by_level[0], by_level[broken]),
    )


def breakdown_point(success: Sequence[float]) -> float | None:
    """Level at which ``success`` by level falls to a half, on the line between levels; None if it never does.

    >>> breakdown_point([1.0, 0.8, 0.2, 0.0])
    1.5
    """
    if success[0] <= 0.5:
        return 0.0
    for level in range(1, len(success)):
        before, now = success[level - 1], success[level]
        if now <= 0.5:
            return level - (0.5 - now) / (before - now)
    return None


def _spread(totals: Sequence[float]) -> float:
    if len(totals) < 2:
        return float("nan")
    low, _, high = quantiles(totals, n=4, method="inclusive")
    return high - low


def _growth(totals: Sequence[float]) -> float:
    third = max(1, len(totals) // 3)
    return fmean(totals[-third:]) - fmean(totals[:third])


def _grown_most(before: Sequence[Row], after: Sequence[Row]) -> str:
    """The term that grew most, of those that both sides have; empty where none grew."""

    def known(rows: Sequence[Row], name: str) -> list[float]:
        return [row["terms"][name] for row in rows if row["terms"].get(name) is not None]

    both = {name: (known(before, name), known(after, name)) for name in after[0]["terms"]}
    grown = {name: fmean(late) - fmean(early) for name, (early, late) in both.items() if early and late}
    most = max(grown, key=lambda name: grown[name], default="")
    return most if most and grown[most] > GROWN else ""


def summary(found: Sequence[StressVerdict]) -> list[list[str]]:
    """Rows under :data:`HEADER`."""
    rows = []
    for verdict in found:
        success = " ".join(f"{share:.2f}" for share in verdict.success)
        numbers = [verdict.worst_tenth, verdict.spread, verdict.growth]
        cells = ["" if math.isnan(number) else f"{number:.2f}" for number in numbers]
        totals = " ".join(f"{total:.1f}" for total in verdict.totals)
        named = [verdict.stressor, verdict.method, success, f"{verdict.area:.2f}"]
        rows.append([*named, totals, _told(verdict), *cells, verdict.grown or "none"])
    return rows


def _told(verdict: StressVerdict) -> str:
    """The breakdown as a level and in the stressor's own unit."""
    if verdict.breakdown is None:
        return "none"
    if verdict.breakdown == 0:
        return "0, without stress"
    stressor = STRESSORS[verdict.stressor]
    if verdict.breakdown < 1:
        return f"{verdict.breakdown:.1f}, before {stressor.levels[0]:g} {stressor.unit}"
    low = int(verdict.breakdown)
    below, above = stressor.levels[low - 1], stressor.levels[min(low, len(stressor.levels) - 1)]
    return f"{verdict.breakdown:.1f}, {below + (verdict.breakdown - low) * (above - below):.3g} {stressor.unit}"
