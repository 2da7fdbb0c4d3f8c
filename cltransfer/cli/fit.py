"""The verb that makes a scene of photographs."""

from __future__ import annotations

import shlex
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .shared import Allow, Json, Quiet, goes_on, show, tell

if TYPE_CHECKING:
    from ..fit import Fitter
    from ..fit._curve import Level

OURS = {  # by representation: the scene's file, what it is drawn by where not by default, what a stopped fit does
    "nerf_grid": ("grid.safetensors", ["renderer.nerf_grid={}"], "goes on from here"),
    "gaussian_splats": ("splats.ply", list[str](), "begins it anew"),
}


def fit(
    posed: Annotated[
        Path, typer.Argument(help="Posed image set: COLMAP, transforms.json, cameras.json, LLFF or EasyMocap.")
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            help="Folder for the scene, empty or new; an unfinished fit there goes on (splats begin anew).",
        ),
    ],
    overrides: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="KEY=VALUE",
            help="Options; `plugins show fit.nerf_grid` explains them, fit.gaussian_splats those of splats.",
        ),
    ] = None,
    representation: Annotated[
        str,
        typer.Option(
            "--as", help="nerf_grid; or gaussian_splats, which needs CUDA and the extra [cuda]; or a plugin's."
        ),
    ] = "nerf_grid",
    allow_plugin: Allow = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Fit a scene to the images of POSED; every eighth is held out and scored on.

    cltransfer fit POSED --as nerf_grid --out grid budget=200000 side=400

    Without a budget cells are added only while the held-out images gain by it. Leaves grid.safetensors (or splats.ply),
    and curve.csv and curve.svg: what each level of detail reached. The last line tells how to transfer into it.
    """
    from ..config.layers import parse_overrides
    from ..plugins import allow
    from ..registry import FITTERS

    allow(allow_plugin or [])
    fitter = FITTERS.build(representation, parse_overrides(overrides or []))
    fitter.require()
    from ..fit._folder import STATE, WRITTEN, check_folder

    check_folder(out)
    from ..computer.threads import set_threads, thread_count
    from ..storage.alone import alone
    from ..storage.unfinished import clear_left

    set_threads(thread_count(), tensors=thread_count())

    def way_on() -> str:
        begun = representation in OURS and (out / STATE).is_file()
        return f"the same command {OURS[representation][2]}: {out}" if begun else ""

    with goes_on(way_on), alone(out, "fits a scene"):
        clear_left(out, WRITTEN)
        levels, notes, up = _fit_into(out, fitter, posed, as_json, quiet)
    values = {"folder": str(out), "levels": [asdict(level) for level in levels], "notes": notes, "up": up}
    lines = [f"{v.cells:>9,} cells {v.psnr:6.2f} dB {v.seconds:6.0f} s{'' if v.kept else '  not kept'}" for v in levels]
    show(values, "\n".join([*lines, f"{out}{_command(out, representation, up)}"]), as_json)


def _command(out: Path, representation: str, up: tuple[float, float, float] | None) -> str:
    """What stands behind the folder of a scene of ours: the command that transfers into it."""
    if representation not in OURS:
        return ""
    from ..scenes.load import usual_up

    file, drawn, _ = OURS[representation]
    said = [] if up is None or up == usual_up(out / file) else ["--up", ",".join(f"{value:g}" for value in up)]
    return "; " + shlex.join(["cltransfer", "transfer", str(out / file), "CLIP", *said, *drawn])


def _fit_into(
    out: Path, fitter: Fitter, posed: Path, as_json: bool, quiet: bool
) -> tuple[list[Level], list[str], tuple[float, float, float] | None]:
    """Fit a scene to a set, and return what each level reached, what was done without, and up by its cameras."""
    from ..fit._upward import upward
    from ..fit._views import left_out, views_of
    from ..progress import progress
    from ..scenes.posed import read_posed

    images = read_posed(posed)
    notes = left_out(images)
    tell(notes, as_json)
    views = views_of(images, fitter.side)
    with progress(quiet) as report:
        return fitter.fit(views, out, report), notes, upward(views.camera)
