"""The command line: one short function a verb. Nothing heavy is imported before a verb needs it."""

from __future__ import annotations

import os
import signal
import sys
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from .. import __version__
from ..bench.verbs import app as bench_app
from ..errors import CltransferError, UsageError, shortened
from .ablate import ablate
from .describe import describe, inspect
from .evaluate import evaluate
from .fit import fit
from .models import assets_app, models_app
from .plugins import app as plugins_app
from .scenes import bake, lift, simplify
from .shared import Allow, Config, Json, Out, Quiet, Up, settings_of, show, tell, unused_plugins, up_of
from .slips import check_order, meant_as_key, meant_as_option, options_of
from .study import study

HELP = """Transfer the camera language of a reference clip into a 3D scene, and score it.

**Try it**: `cltransfer transfer` runs on built-in scenes, nothing to download.

**Your own**: `cltransfer transfer scene.ply clip.mp4 --out run frames=24`

**Score two clips**: `cltransfer evaluate clip.mp4 render.mp4`

Anything in a config can be set as key=value: `generations=20 losses.framing=null search.paper_box={}`.
"""

app = typer.Typer(
    help=HELP, no_args_is_help=True, rich_markup_mode="markdown", pretty_exceptions_enable=False, add_completion=True
)
app.add_typer(bench_app, name="bench")
app.add_typer(plugins_app, name="plugins")
app.add_typer(models_app, name="models")
app.add_typer(assets_app, name="assets")

DEFAULT_SCENE, DEFAULT_REFERENCE = "builtin:courtyard", "builtin:dolly_zoom"


def main() -> NoReturn:
    """Run the command line; every failure is one line on stderr and an exit code."""
    signal.signal(signal.SIGTERM, _terminate)
    _show_every_letter()
    try:
        code = app(standalone_mode=False)
        if code == 130:  # the parser's word for an interrupt
            _fail("interrupted", code)
    except _Terminated:
        _fail("terminated", 143)
    except CltransferError as error:
        if error.__cause__ is not None and _debugging():
            raise
        if isinstance(error, UsageError):
            verb = typer.main.get_command(app)
            for word in sys.argv[1:3]:  # `models align` has options of its own
                verb = getattr(verb, "commands", {}).get(word, verb)
            error = meant_as_option(error, options_of(verb), sys.argv)
        _fail(error, error.exit_code)
    except typer.Abort:
        _fail("interrupted", 130)
    except KeyboardInterrupt:
        _fail("interrupted", 130)
    except MemoryError:
        _fail("out of memory (fewer frames, or smaller search_side and output_side)", 5)
    except OSError as error:
        _fail(f"{shortened(error.filename or 'file')}: {shortened(error.strerror or error)}", 5)
    except Exception as error:
        if hasattr(error, "exit_code") and hasattr(error, "format_message"):  # usage errors of the parser
            _fail(meant_as_key(error, sys.argv), error.exit_code)
        if _debugging():
            raise
        _fail(f"{type(error).__name__}: {shortened(error)} (a fault of cltransfer; CLTRANSFER_DEBUG=1 shows where)", 1)
    sys.exit(code if isinstance(code, int) else 0)


def _show_every_letter() -> None:
    """Letters that the terminal or the pipe does not know, as in names that are no UTF-8, are shown escaped."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _debugging() -> bool:
    return os.environ.get("CLTRANSFER_DEBUG") == "1"


class _Terminated(BaseException):
    """SIGTERM; no ``except Exception`` on the way may keep it."""


def _terminate(number: int, frame: object) -> NoReturn:
    raise _Terminated


def _fail(reason: object, code: int) -> NoReturn:
    line = " ".join(str(reason).split())
    print(f"error: {line}", file=sys.stderr)
    sys.exit(code)


@app.callback(invoke_without_command=True)
def _root(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    if version:
        print(__version__)
        raise typer.Exit


@app.command()
def transfer(
    arguments: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[SCENE] [REFERENCE] [KEY=VALUE]...",
            help="Scene: splats (.ply, .splat, .spz), a grid .safetensors, a mesh (.glb, .gltf, .obj, .ply; with "
            "renderer.mesh={}), a .yaml of meshes or builtin:NAME (courtyard, the default, plaza, room, stage, path). "
            "Reference: a video, an image folder (24 images/s unless FOLDER#fps=30 or its times.json says), "
            "CLIP#t=START,END for a part, a .safetensors feature file, SCENE@TRAJECTORY.json or builtin:SHOT "
            "(dolly_zoom, the default, push_in, pull_out, pan, tilt, orbit, zoom, crash_zoom, dutch, boom, truck, "
            "static, handheld).",
        ),
    ] = None,
    out: Out = None,
    init: Annotated[
        str,
        typer.Option(
            help="Initial view: auto, a trajectory file (its first camera), or SET:INDEX of a posed image set "
            "(COLMAP, transforms.json, cameras.json, poses_bounds.npy, EasyMocap)."
        ),
    ] = "auto",
    subject: Annotated[Path | None, typer.Option(help="subject.json of `cltransfer lift`; else it is lifted.")] = None,
    up: Up = None,
    resume: Annotated[
        Path | None,
        typer.Option(help="Go on with the killed run in this folder: the same command again with --resume FOLDER."),
    ] = None,
    config: Config = None,
    print_config: Annotated[bool, typer.Option("--print-config", help="Print the merged config and stop.")] = False,
    allow_plugin: Allow = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Find the cameras that shoot SCENE the way REFERENCE is shot.

    cltransfer transfer builtin:room-3 builtin:orbit preset=fast frames=12 --out run

    Leaves trajectory.json, camera/camera_path.json (nerfstudio), metrics.json, metrics.csv, video/render.mp4,
    video/side_by_side.mp4, video/frames.mkv, strip.jpg, subject.json, config.yaml and report.html in the run folder,
    and prints the five metrics. Clips and scenes of your own need two networks: cltransfer models pull default.
    """
    paths, overrides = _split(arguments or [], 2)
    if resume is not None and out not in (None, resume):
        raise UsageError("", "--out", "a run is resumed in its own folder", "leave out --out or --resume")
    settings = settings_of(config, overrides, allow_plugin)
    if print_config:
        from ..config import to_yaml

        print(to_yaml(settings), end="")
        return
    scene, reference = (
        [*paths, DEFAULT_SCENE, DEFAULT_REFERENCE][:2] if len(paths) != 1 else [paths[0], DEFAULT_REFERENCE]
    )
    check_order(scene, reference)
    from ..progress import progress
    from ..run.folder import default_folder, summary_lines, summary_values, write_run
    from ..storage.run_files import DONE, JOURNAL, open_run
    from ..transfer import Inputs, Record
    from ..transfer import transfer as run

    inputs = Inputs(scene, reference, init, subject, up_of(up))
    folder = open_run(resume or out or default_folder(scene, reference), resume is not None)
    if resume is None and (folder / DONE).is_file() and not quiet:
        print(f"note: the run in {folder} will be replaced (--out FOLDER keeps it)", file=sys.stderr)
    try:
        with progress(quiet) as report:
            result = run(inputs, settings, report, Record(folder / JOURNAL, resume is not None))
            shown = write_run(folder, result, inputs, settings, allow_plugin or [])
    except KeyboardInterrupt:
        begun = (folder / JOURNAL).is_file() and not (folder / DONE).is_file()
        _fail("interrupted" + f" (the same command with --resume {folder} goes on from here)" * begun, 130)
    show(summary_values(folder, shown), summary_lines(folder, shown), as_json)
    taken = [f"no reference named: {reference} is taken"] if len(paths) == 1 else []
    tell([*taken, *unused_plugins(allow_plugin, settings)], as_json)


@app.command()
def render(
    run: Annotated[Path, typer.Argument(help="Folder of a run.")],
    overrides: Annotated[
        list[str] | None,
        typer.Argument(metavar="[KEY=VALUE]...", help="output_side=1280, renderer.NAME.OPTION=VALUE, threads=1."),
    ] = None,
    fps: Annotated[
        float | None, typer.Option(help="Frames a second, between those of the run too; default: only those it has.")
    ] = None,
    scene: Annotated[str | None, typer.Option(help="The scene, where this computer has not seen it before.")] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Video; default RUN/video/render.mp4.")] = None,
    allow_plugin: Allow = None,
    quiet: Quiet = False,
) -> None:
    """Render the video of RUN again, larger, or smoothly from frame to frame.

    cltransfer render run output_side=1280 --fps 24 --out shot.mp4
    """
    from ..plugins import allow

    allow(allow_plugin or [])
    from ..progress import progress
    from ..run.render import render_run

    with progress(quiet) as report:
        film = render_run(run, overrides or [], fps, scene, out, report)
    print(film.video)
    tell(list(film.notes), as_json=False)


for verb in (evaluate, ablate, inspect, describe, lift, fit, bake, simplify, study):  # as `--help` lists them
    app.command()(verb)


@app.command()
def doctor(as_json: Json = False) -> None:
    """What this computer has: versions, threads, codecs, models and where they are looked for, a self-test."""
    from ..doctor import examine, healthy

    findings = examine()
    width = max(len(f.what) for f in findings)
    text = "\n".join(f"{'ok ' if f.ok else 'NO '} {f.what:<{width}}  {f.says}" for f in findings)
    show([vars(f) for f in findings], text, as_json)
    if not healthy(findings):
        raise typer.Exit(4)


def _split(arguments: list[str], most: int) -> tuple[list[str], list[str]]:
    """Paths first, then key=value; a path that holds '=' must exist."""
    paths = [a for a in arguments if not _is_override(a)]
    if len(paths) > most:
        raise UsageError("", paths[most], f"expected at most {most} paths, got {len(paths)}")
    return paths, [a for a in arguments if _is_override(a)]


def _is_override(argument: str) -> bool:
    key = argument.partition("=")[0]
    return "=" in argument and key.replace(".", "").replace("_", "").isalnum() and not os.path.exists(argument)
