"""The chart: what accuracy costs. One point for each preset, baseline, resolution, level of detail and budget."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from statistics import fmean, median

from ..storage.files import csv_text
from .measures import clip_of, number
from .protocol import SCENES, Tier, Trial
from .trial import Row

TARGETS = (0.5, 1.0, 2.0)  # totals whose hits are counted; 1 is every term at its tolerance


@dataclass(frozen=True)
class Setting:
    """One point of the chart.

    Args:
        family: settings that differ in one thing are of one family, and joined.
        label: what it is called.
        method: see :mod:`cltransfer.bench.methods`.
        options: config overrides over the method's.
    """

    family: str
    label: str
    method: str
    options: tuple[str, ...] = ()


def ladder(
    family: str, method: str, option: str, values: Sequence[object], unit: str, base: str
) -> tuple[Setting, ...]:
    """The method with one option at several values, and as it is: then ``base`` is its value."""
    changed = [Setting(family, f"{value} {unit}".strip(), method, (f"{option}={value}",)) for value in values]
    return (*changed, Setting(family, f"{base} {unit}".strip(), method))


BASELINES = ("jaws_clean", "jaws_code", "jaws_losses_cma", "five_adam", "replay", "replay_drift", "replay_rebuilt")
SETTINGS = (
    *(Setting("presets", name, name) for name in ("fast", "balanced", "max", "paper")),
    *(Setting("baselines", name, name) for name in BASELINES),
    *ladder("resolution", "balanced", "search_side", (96, 128, 224, 320), "px", "160"),
    *ladder("level of detail", "balanced", "lod", (1.0, 2.0, 4.0), "px merged", "0"),
    *ladder("CMA-ES, generations", "cma", "generations", (5, 10, 25, 50), "gen", "100"),
    *ladder("CMA-ES, population", "cma", "popsize", (6, 20), "pop", "10"),
    *ladder("JAWS, iterations", "jaws_clean", "adam.iterations", (5, 10, 20), "it", "40"),
    *ladder("five losses, Adam, iterations", "five_adam", "adam.iterations", (5, 10, 20), "it", "42"),
)
SMOKE_SETTINGS = (
    *(Setting("presets", name, name) for name in ("fast", "balanced")),
    *ladder("resolution", "fast", "search_side", (96,), "px", "160"),
)

_PAIRS = tuple(zip(SCENES, (*SCENES[1:], SCENES[0])))
CHART_TIERS = {
    "smoke": Tier(("push_in", "orbit", "dolly_zoom"), (("plaza", "room"),), 1, 1, 8),
    "standard": Tier(("push_in", "orbit", "dolly_zoom", "handheld"), _PAIRS, 1, 1, 8),
    "full": Tier(("push_in", "orbit", "dolly_zoom", "crash_zoom", "pan", "handheld"), _PAIRS, 4, 2, 24),
}


def chart_trials(settings: Sequence[Setting], tier: Tier, seeds: Sequence[int] = ()) -> list[Trial]:
    """Every setting on every clip."""
    return [Trial(s.method, *clip, tier.frames, s.options) for clip in tier.clips(seeds) for s in settings]


@dataclass(frozen=True)
class Point:
    """What a setting costs and reaches, over its clips.

    Args:
        family, label: of the setting.
        clips: how many.
        evaluations: a frame, mean.
        seconds: a clip, mean.
        total, median_total: mean and median over clips; 1 is every term at its tolerance.
        success: share of clips that have not failed.
    """

    family: str
    label: str
    clips: int
    evaluations: float
    seconds: float
    total: float
    median_total: float
    success: float


def points(settings: Sequence[Setting], rows: Sequence[Row]) -> list[Point]:
    """One point a setting."""
    found = []
    for setting in settings:
        own = [row for row in rows if (row["method"], tuple(row["options"])) == (setting.method, setting.options)]
        totals = [number(row["total"]) for row in own]
        found.append(
            Point(
                family=setting.family,
                label=setting.label,
                clips=len(own),
                evaluations=fmean(row["evaluations"] for row in own),
                seconds=fmean(row["seconds"] for row in own),
                total=fmean(totals),
                median_total=median(totals),
                success=fmean(not row["failed_clip"] for row in own),
            )
        )
    return found


def pareto(costs: Sequence[float], losses: Sequence[float]) -> list[int]:
    """Indices of the points that no other beats, cheapest first; both are better when lower, and equals stay together.

    >>> pareto([1.0, 2.0, 3.0, 2.5, 2.5], [5.0, 3.0, 4.0, 1.0, 1.0])
    [0, 1, 3, 4]
    """
    front: list[int] = []
    for i in sorted(range(len(costs)), key=lambda i: (costs[i], losses[i])):
        last = front[-1] if front else None
        if last is None or losses[i] < losses[last] or (costs[i], losses[i]) == (costs[last], losses[last]):
            front.append(i)
    return front


@dataclass(frozen=True)
class Hits:
    """Share of clips at or below a target, over the evaluations a frame they took.

    Args:
        family: whose runs are counted: each clip by its cheapest one that hits.
        target: total.
        evaluations: a frame at which another clip is hit, rising.
        share: of all clips, rising; the same length.
        least, most: evaluations a frame of the family's runs.
    """

    family: str
    target: float
    evaluations: tuple[float, ...]
    share: tuple[float, ...]
    least: float
    most: float


def hits(family: str, rows: Sequence[Row], target: float) -> Hits:
    """The target-hit curve of a family's rows."""
    cheapest: dict[tuple[str, str, str, int, int], float] = {}
    for row in rows:
        if number(row["total"]) <= target and row["evaluations"] < cheapest.get(clip_of(row), float("inf")):
            cheapest[clip_of(row)] = row["evaluations"]
    at, clips = sorted(cheapest.values()), len({clip_of(row) for row in rows})
    spent = [row["evaluations"] for row in rows]
    return Hits(family, target, tuple(at), tuple((i + 1) / clips for i in range(len(at))), min(spent), max(spent))


# whose budgets make one curve
CURVES = {
    "ours": (("fast", ()), ("balanced", ()), ("max", ())),
    "CMA-ES about the subject": (("cma", ()), *(("cma", (f"generations={n}",)) for n in (5, 10, 25, 50))),
    "five losses, Adam": (("five_adam", ()), *(("five_adam", (f"adam.iterations={n}",)) for n in (5, 10, 20))),
    "JAWS": (("jaws_clean", ()), *(("jaws_clean", (f"adam.iterations={n}",)) for n in (5, 10, 20))),
    "paper": (("paper", ()),),
}


def hit_curves(rows: Sequence[Row]) -> list[Hits]:
    """Curves of every family that has run, for every target."""
    found = []
    for family, members in CURVES.items():
        own = [row for row in rows if (row["method"], tuple(row["options"])) in members]
        if own:
            found += [hits(family, own, target) for target in TARGETS]
    return found


def points_csv(found: Sequence[Point]) -> str:
    """One line a point, with whether it lies on the front of either cost."""
    names = [f.name for f in fields(Point)]
    totals = [p.total for p in found]
    fronts = [pareto([getattr(p, cost) for p in found], totals) for cost in ("evaluations", "seconds")]
    lines = (
        [*(getattr(p, name) for name in names), *(int(i in front) for front in fronts)] for i, p in enumerate(found)
    )
    return csv_text([[*names, "front_by_evaluations", "front_by_seconds"], *lines])


def hits_csv(curves: Sequence[Hits]) -> str:
    """One line for each step of each curve."""
    lines = ([c.family, c.target, *at] for c in curves for at in zip(c.evaluations, c.share))
    return csv_text([["family", "target", "evaluations", "share"], *lines])
