"""The verbs that run the protocol: ``bench table1`` and ``bench chart``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

from .arguments import Jobs, Out, command_line

TierName = Literal["smoke", "standard", "full"]
Tier = Annotated[
    TierName,
    typer.Option(help="How much: smoke shows that it works; full takes tens of core hours and tells how long."),
]
Seeds = Annotated[
    list[int] | None,
    typer.Option(
        "--seed", "--seeds", min=0, help="Seeds (repeatable) in place of those from 1000 on, which have been seen."
    ),
]
Rows = Annotated[Path, typer.Option(help="Folder of rows, tables and found paths; what is there is not run again.")]
Networks = Annotated[bool, typer.Option(help="Read the results by the networks too, which no method saw; slow.")]


def bench_table1(
    tier: Tier = "standard",
    seed: Seeds = None,
    baseline: Annotated[
        list[str] | None, typer.Option(help="Methods to beat (repeatable); by default jaws_clean.")
    ] = None,
    ours: Annotated[str, typer.Option(help="The method held against them.")] = "balanced",
    form: Annotated[
        Literal["splats", "mesh", "grid"], typer.Option(help="Of the scenes that are taught: the same geometry.")
    ] = "splats",
    jobs: Jobs = 1,
    networks: Networks = False,
    rows: Rows = Path("outputs/table1"),
    out: Out = None,
) -> None:
    """Table 1: JAWS against ours on the five metrics, clip by clip, with and without the frames that failed."""
    from ..storage.files import check_out
    from .protocol import TIERS
    from .rows import run_trials
    from .table1 import duels, markdown, write_table1

    check_out(rows)
    baselines = baseline or ["jaws_clean"]
    trials = TIERS[tier].trials([*baselines, ours], seed or (), form)
    measured = run_trials(trials, rows, jobs, _told, networks)
    found = duels(measured, baselines, ours)
    write_table1(measured, found, rows, out, command_line())
    print("\n".join(markdown(found)))


def bench_chart(
    tier: Tier = "standard",
    seed: Seeds = None,
    jobs: Jobs = 1,
    rows: Rows = Path("outputs/chart"),
    out: Out = None,
) -> None:
    """The chart: loss and success against evaluations and seconds, for presets, baselines and budgets."""
    from ..storage.files import check_out
    from .chart import CHART_TIERS, SETTINGS, SMOKE_SETTINGS, chart_trials, points, points_csv
    from .chart_svg import write_chart
    from .rows import run_trials

    check_out(rows)
    settings = SMOKE_SETTINGS if tier == "smoke" else SETTINGS
    measured = run_trials(chart_trials(settings, CHART_TIERS[tier], seed or ()), rows, jobs, _told)
    write_chart(measured, settings, rows, out, command_line())
    print(points_csv(points(settings, measured)), end="")


def _told(line: str) -> None:
    print(line, file=sys.stderr)
