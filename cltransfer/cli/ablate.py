"""The verb that runs a table of overrides."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from .shared import Allow, Json, Quiet, goes_on, show, tell, unused_plugins


def ablate(
    file: Annotated[str, typer.Argument(help="Ablation file, or a shipped one by name: leave_one_out, presets, ...")],
    overrides: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="KEY=VALUE",
            help="The sweep's are seeds=[0,1] scenes=[..] references=[..] engine.workers=4 engine.backend=dask "
            "engine.address=tcp://.. (a cluster is named here, not in FILE); anything else goes on top of every row.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder; a sweep begun there goes on; by default outputs/ablations/NAME."),
    ] = None,
    keep_runs: Annotated[bool, typer.Option("--keep-runs", help="Keep every run's whole folder in OUT/runs.")] = False,
    retry: Annotated[bool, typer.Option("--retry", help="Run failed trials again.")] = False,
    allow_plugin: Allow = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Run a table of overrides on the same cases, and compare the rows.

    cltransfer ablate leave_one_out 'seeds=[0]' 'references=[drawn:orbit]' --out first

    FILE names rows of overrides, rows: {plain: {}, heavy: {losses: {framing: {weight: 20}}}}, or has axes whose every
    combination is a row, axes: {losses.framing.weight: [5, 10], losses.shot_size.mode: [robust, faithful]}.

    Every finished trial is on disk at once; the same command, which stands at the head of ablation.yaml, goes on after
    a kill. Leaves trials.jsonl, table.csv, table.md, table.tex and summary.json, and references/, the cameras of drawn
    shots. The exit code is 1 where a trial failed; its reason is in the table.
    """
    from ..ablate.read import read_sweep
    from ..plugins import allow

    allow(allow_plugin or [])
    sweep = read_sweep(file, overrides or [])
    from ..ablate.run import Options, markdown, summary_values
    from ..ablate.run import ablate as run
    from ..progress import progress

    folder = out or Path("outputs") / "ablations" / sweep.name
    with goes_on(lambda: f"the same command goes on from here: {folder}"), progress(quiet) as report:
        command = shlex.join(["cltransfer", *sys.argv[1:]])
        found = run(sweep, Options(folder, keep_runs, retry, tuple(allow_plugin or []), command), report)
    lines = [*markdown(found), "", str(folder)]
    if found.unkept:
        lines += [f"note: {found.unkept} trials had been run without --keep-runs; another --out keeps them all"]
    show({"folder": str(folder), "unkept": found.unkept, **summary_values(found)}, "\n".join(lines), as_json)
    tell(unused_plugins(allow_plugin, sweep.metrics, *(row.config for row in sweep.rows)), as_json)
    if found.failed:
        raise typer.Exit(1)
