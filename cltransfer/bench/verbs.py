"""The verbs of ``cltransfer bench``: one short function each, nothing heavy imported before it is needed."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, TypeVar

import typer

from .arguments import LAST_SEED, Jobs, Out, command_line, folder, page_folder
from .protocol_verbs import bench_chart, bench_table1
from .stress.verb import bench_stress

HELP = "Measure: the figures in docs/benchmarks.md are made here, those of the ablations by `cltransfer ablate`."

Row = TypeVar("Row")
Seeds = Annotated[list[int] | None, typer.Option(min=0, help="Seeds of the synthetic rooms (repeatable).")]
Quick = Annotated[bool, typer.Option(help="Small sizes only: checks the bench, measures little.")]

app = typer.Typer(help=HELP, no_args_is_help=True)
app.command("table1")(bench_table1)
app.command("chart")(bench_chart)
app.command("stress")(bench_stress)


def _show(rows: Iterable[Row], out: Path | None, write: Callable[[list[Row], Path, str], None]) -> None:
    """Print each row as it comes, and ``write`` them all."""
    shown = []
    for row in rows:
        print(row)
        shown.append(row)
    if out is not None:
        write(shown, out, command_line())


@app.command("speed")
def bench_speed(
    scene: Annotated[
        list[Path] | None, typer.Argument(help="Splat .ply files to time beside the synthetic rooms.")
    ] = None,
    seed: Seeds = None,
    quick: Quick = False,
    out: Out = None,
) -> None:
    """Splat rendering: speed and accuracy of every setting, against the torch oracle in the same run."""
    from .speed import run_speed
    from .timing import write_benchmarks

    _show(run_speed(seed or [0, 1, 2], scene or [], quick), out, write_benchmarks)


@app.command("cuda")
def bench_cuda(
    scene: Annotated[list[Path] | None, typer.Argument(help="Splat .ply files beside the synthetic rooms.")] = None,
    out: Out = None,
) -> None:
    """Splats on a CUDA device: frames per second for 10 and 64 candidates, and PSNR against the torch oracle."""
    from .cuda_speed import run_cuda, write_cuda

    _show(run_cuda(scene or []), out, write_cuda)


@app.command("mesh")
def bench_mesh(
    scene: Annotated[list[Path] | None, typer.Argument(help="Meshes to time beside the synthetic rooms.")] = None,
    seed: Seeds = None,
    quick: Quick = False,
    out: Out = None,
) -> None:
    """Mesh rendering: speed and accuracy of every setting, against the torch oracle in the same run."""
    from .mesh_speed import run_mesh_speed
    from .timing import write_benchmarks

    _show(run_mesh_speed(seed or [0, 1, 2], scene or [], quick), out, write_benchmarks)


@app.command("grid")
def bench_grid(
    seed: Seeds = None,
    quick: Quick = False,
    out: Out = None,
) -> None:
    """Voxel grid rendering: speed and accuracy of every setting, against the torch oracle in the same run."""
    from .grid_speed import run_grid_speed
    from .timing import write_benchmarks

    _show(run_grid_speed(seed or [0, 1, 2], quick), out, write_benchmarks)


@app.command("lod")
def bench_lod(
    scene: Annotated[list[Path] | None, typer.Argument(help="Splat .ply files beside the synthetic room.")] = None,
    members: Annotated[
        int,
        typer.Option(
            min=0, help="How many of the first Gaussians of each file are its person, in scenes put together."
        ),
    ] = 0,
    seed: Annotated[list[int] | None, typer.Option(min=0, help="Seeds of the candidates (repeatable).")] = None,
    count: Annotated[int, typer.Option(min=1, help="Gaussians of the synthetic room.")] = 500_000,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", callback=page_folder, help="Folder for lod.csv, lod.svg and benchmarks.md."),
    ] = None,
) -> None:
    """Level of detail: what merging gains in speed and costs in images, depth and the ranking of candidates."""
    from .lod import labelled_scene, room_scene, run_lod
    from .lod_chart import write_lod

    scenes = [room_scene(count), *(labelled_scene(path, members) for path in scene or [])]
    _show(run_lod(scenes, seed or [0, 1, 2]), out, write_lod)


@app.command("driver")
def bench_driver(
    seeds: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="seeds=FIRST:LAST",
            help="Where the shots stand; seeds=500:520 are published, those to 691 were seen, 0 is the default.",
        ),
    ] = None,
    seed: Annotated[list[int] | None, typer.Option(min=0, help="A single seed (repeatable).")] = None,
    preset: Annotated[
        list[str] | None, typer.Option(help="Presets to compare (repeatable); by default fast and balanced.")
    ] = None,
    shot: Annotated[list[str] | None, typer.Option(help="Canonical shots; all where none is named.")] = None,
    paper_shots: Annotated[
        int,
        typer.Option(min=0, help="Shots of each seed, in turn, on which the paper's setting runs too; 2 minutes each."),
    ] = 0,
    frames: Annotated[int, typer.Option(min=1, help="Frames of each clip.")] = 24,
    jobs: Jobs = 1,
    rows: Annotated[Path, typer.Option(callback=folder, help="Folder of rows; what is there is not run again.")] = Path(
        "outputs/driver"
    ),
    out: Out = None,
) -> None:
    """The driver on canonical shots: loss, pose error, jerk, evaluations and seconds by preset, and their chart."""
    import sys

    from ..shots import SHOTS
    from .driver import Bench, clips_of, run_driver, seed_range
    from .driver_table import HEADER, summary, write_driver
    from .section import table

    drawn = [*(seed or []), *(number for text in seeds or [] for number in seed_range(text))]
    presets = tuple(preset or ["fast", "balanced"])
    bench = Bench(tuple(drawn or [0]), presets, tuple(shot or SHOTS), paper_shots, frames)
    measured = run_driver(bench, rows, jobs, lambda line: print(line, file=sys.stderr))
    print("\n".join(table(HEADER, summary(clips_of(measured)))))
    if out is not None:
        write_driver(measured, out, command_line())


@app.command("pool")
def bench_pool(
    clips: Annotated[list[Path], typer.Argument(metavar="driver.csv", help="What `bench driver --out` wrote.")],
    out: Out = None,
) -> None:
    """Runs of the driver bench together, of seeds that differ: by preset and by shot, against the paper's setting."""
    from .pool import read_together, report_lines, write_pool

    together = read_together(clips)
    print("\n".join(report_lines(together)))
    if out is not None:
        write_pool(together, out, command_line())


@app.command("flow")
def bench_flow(
    scene: Annotated[list[str] | None, typer.Argument(help="Scenes; the built-in ones where none is named.")] = None,
    seed: Annotated[
        list[int] | None, typer.Option(min=0, max=LAST_SEED, help="Seeds of where the shots stand (repeatable).")
    ] = None,
    shot: Annotated[list[str] | None, typer.Option(help="Canonical shots; all where none is named.")] = None,
    method: Annotated[
        list[str] | None,
        typer.Option(help="An extractor and its options, as in 'flow_dis={preset: fast}' (repeatable)."),
    ] = None,
    out: Out = None,
) -> None:
    """Optical flow on rendered pairs whose flow is known: error by length, with and without the confidence, time."""
    import sys

    from ..computer.threads import set_threads
    from ..shots import SHOTS
    from .flow import HEADER, SCENES, named_methods, rendered_pairs, run_flow, summary, write_flow
    from .section import table

    set_threads(1)
    pairs = rendered_pairs(scene or SCENES, seed or [0], shot or SHOTS)
    scores = run_flow(named_methods(method), pairs, lambda done: print(f"{done} pairs", file=sys.stderr))
    print("\n".join(table(HEADER, summary(scores))))
    if out is not None:
        write_flow(scores, out, command_line())


@app.command("describe")
def bench_describe(
    seed: Annotated[
        list[int] | None, typer.Option(min=0, max=LAST_SEED, help="Seeds of where the cameras stand (repeatable).")
    ] = None,
    networks: Annotated[bool, typer.Option("--networks", help="Read renders by networks too.")] = False,
    out: Out = None,
) -> None:
    """Descriptions against the known labels of canonical shots and shot sizes: confusion matrices."""
    import sys

    from ..config import load_config
    from ..pipeline.components import Components
    from .describe import report_lines, run_describe, write_describe

    readers = ("geometry", "networks") if networks else ("geometry",)
    parts = Components.build(load_config())
    answers = run_describe(seed or [1, 2, 3], readers, parts, lambda step: print(step, file=sys.stderr))
    print("\n".join(report_lines(answers)))
    if out is not None:
        write_describe(answers, out, command_line())
