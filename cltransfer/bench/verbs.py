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


@app.command("lod")
def bench_lod(
    scene: Annotated[list[Path] | None, typer.Argument(help="Splat .ply files beside the synthetic room.")] = None,
    members: Annotated[
        int, typer.Option(help="So many first Gaussians of each file are its subject, as in scenes put together.")
    ] = 0,
    seed: Annotated[list[int] | None, typer.Option(help="Seeds of the candidates (repeatable).")] = None,
    count: Annotated[int, typer.Option(help="Gaussians of the synthetic room.")] = 500_000,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder for lod.csv, lod.svg and benchmarks.md.")
    ] = None,
) -> None:
    """Level of detail: what merging gains in speed and costs in images, depth and the ranking of candidates."""
    from .lod import labelled_scene, room_scene, run_lod
    from .lod_chart import write_lod

    scenes = [room_scene(count), *(labelled_scene(path, members) for path in scene or [])]
    rows = []
    for row in run_lod(scenes, seed or [0, 1, 2]):
        print(row)
        rows.append(row)
    if out is not None:
        write_lod(rows, out)
