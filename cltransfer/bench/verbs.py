"""The verbs of ``cltransfer bench``: one short function each, nothing heavy imported before it is needed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(help="Measure: every figure in docs/benchmarks.md is made here.", no_args_is_help=True)


@app.command("speed")
def bench_speed(
    scene: Annotated[
        list[Path] | None, typer.Argument(help="Splat .ply files to time beside the synthetic rooms.")
    ] = None,
    seed: Annotated[list[int] | None, typer.Option(help="Seeds of the synthetic rooms (repeatable).")] = None,
    quick: Annotated[bool, typer.Option(help="Small sizes only: checks the bench, measures little.")] = False,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Markdown file whose speed section is rewritten.")
    ] = None,
) -> None:
    """Splat rendering: speed and accuracy of every setting, against the torch oracle in the same run."""
    from .speed import run_speed, write_benchmarks

    rows = run_speed(seed or [0, 1, 2], scene or [], quick)
    for row in rows:
        print(row)
    if out is not None:
        write_benchmarks(rows, out)


@app.command("mesh")
def bench_mesh(
    scene: Annotated[list[Path] | None, typer.Argument(help="Meshes to time beside the synthetic rooms.")] = None,
    seed: Annotated[list[int] | None, typer.Option(help="Seeds of the synthetic rooms (repeatable).")] = None,
    quick: Annotated[bool, typer.Option(help="Small sizes only: checks the bench, measures little.")] = False,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Markdown file whose mesh section is rewritten.")
    ] = None,
) -> None:
    """Mesh rendering: speed and accuracy of every setting, against the torch oracle in the same run."""
    from .mesh_speed import run_mesh_speed, write_benchmarks

    rows = run_mesh_speed(seed or [0, 1, 2], scene or [], quick)
    for row in rows:
        print(row)
    if out is not None:
        write_benchmarks(rows, out)
