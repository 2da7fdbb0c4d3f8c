"""The verb ``cltransfer bench stress``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from ..arguments import Jobs, Out, command_line, folder

FIXED = {  # what no override may say: expected, and what to do
    "frames": ("the tier and the stressor say how many frames a clip has", "leave it out"),
    "seed": ("a clip's seed is the method's too", "use --seed"),
}


def bench_stress(
    overrides: Annotated[
        list[str] | None, typer.Argument(metavar="KEY=VALUE", help="Over every method's config: floaters=keep.")
    ] = None,
    tier: Annotated[
        Literal["smoke", "standard", "full"], typer.Option(help="How much; full takes about a day on two cores.")
    ] = "standard",
    method: Annotated[
        list[str] | None,
        typer.Option(
            help="Methods (repeatable); by default balanced, jaws_clean and replay; two in smoke, seven in full."
        ),
    ] = None,
    stressor: Annotated[list[str] | None, typer.Option(help="Stressors; all of the tier where none is named.")] = None,
    seed: Annotated[
        list[int] | None, typer.Option("--seed", "--seeds", min=0, help="Seeds (repeatable) instead of the tier's.")
    ] = None,
    jobs: Jobs = 1,
    rows: Annotated[Path, typer.Option(callback=folder, help="Folder of rows; what is there is not run again.")] = Path(
        "outputs/stress"
    ),
    out: Out = None,
) -> None:
    """Where methods fail: what they are given is made worse, step by step; success, breakdown, tail, spread, cause."""
    import sys
    from dataclasses import replace

    from ...errors import UsageError
    from ..pages import SECTIONS, check_page
    from ..section import table
    from .bench import TIERS, run_bench, write_stress
    from .verdicts import HEADER, summary, verdicts

    for text in overrides or ():
        if text.partition("=")[0] in FIXED:
            raise UsageError("", text, *FIXED[text.partition("=")[0]])
    bench = TIERS[tier].under(tuple(overrides or ()))
    bench = replace(
        bench,
        methods=tuple(method or bench.methods),
        stressors=tuple(stressor or bench.stressors),
        seeds=tuple(dict.fromkeys(seed or bench.seeds)),
    )
    out = out or rows / "stress.md"
    check_page(out, SECTIONS["stress"])
    measured = run_bench(bench, rows, jobs, lambda line: print(line, file=sys.stderr))
    print("\n".join(table(HEADER, summary(verdicts(measured)))))
    write_stress(measured, out, command_line())
