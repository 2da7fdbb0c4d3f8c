"""The verbs that make cameras of a reference and a scene, their video and their files: transfer, render and export."""

from __future__ import annotations

import os
import shlex
import sys
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import UsageError
from .shared import (
    Allow,
    Config,
    Json,
    Out,
    Quiet,
    Up,
    check_keys,
    goes_on,
    settings_of,
    show,
    tell,
    unused_plugins,
    up_of,
)
from .slips import check_order, is_override

if TYPE_CHECKING:
    from ..config.options import RunConfig
    from ..report.data import ReportData
    from ..transfer import Inputs

DEFAULT_SCENE, DEFAULT_REFERENCE = "builtin:courtyard", "builtin:dolly_zoom"


def transfer(
    scene: Annotated[
        str | None,
        typer.Argument(
            metavar="SCENE",
            help="Splats (.ply, .splat, .spz), a grid .safetensors, a mesh (.glb, .gltf, .obj, .ply; with "
            "renderer.mesh={}), a .yaml of meshes or builtin:NAME (courtyard, the default, plaza, room, stage, path).",
        ),
    ] = None,
    reference: Annotated[
        str | None,
        typer.Argument(
            metavar="REFERENCE",
            help="A video, an image folder (24 images/s unless FOLDER#fps=30 or its times.json says), "
            "CLIP#t=START,END for a part, a .safetensors feature file, SCENE@TRAJECTORY.json or builtin:SHOT "
            "(dolly_zoom, the default, push_in, pull_out, pan, tilt, orbit, zoom, crash_zoom, dutch, boom, truck, "
            "static, handheld), as many frames long as frames= says, by default 24, at 12 a second.",
        ),
    ] = None,
    more: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="KEY=VALUE",
            help="Over the config, wherever they stand: preset=fast frames=12; `cltransfer plugins show config` has "
            "all keys.",
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
    subject: Annotated[
        str | None,
        typer.Option(
            help="subject.json of `cltransfer lift`, or a number: 0 is the person that most views see, 1 the next."
        ),
    ] = None,
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
    video/side_by_side.mp4 and strip.jpg (not of a feature file, which has no pictures), video/frames.mkv, subject.json,
    config.yaml and report.html in the run folder, and prints the five metrics; `cltransfer export` takes the camera to
    Blender, USD or COLMAP. Clips and scenes of your own need two networks: cltransfer models pull default.
    """
    paths, overrides = split([word for word in (scene, reference, *(more or ())) if word is not None])
    if resume is not None and out is not None and out.resolve() != resume.resolve():
        raise UsageError("", "--out", "a run is resumed in its own folder", "leave out --out or --resume")
    settings = settings_of(config, overrides, allow_plugin)
    if print_config:
        from ..config import to_yaml
        from ..pipeline.components import Components

        Components.build(settings)  # what cannot run is not approved of
        settings.build_one("search")
        print(to_yaml(settings), end="")
        return
    scene, reference = (
        [*paths, DEFAULT_SCENE, DEFAULT_REFERENCE][:2] if len(paths) != 1 else [paths[0], DEFAULT_REFERENCE]
    )
    check_order(scene, reference)
    from ..run.folder import default_folder, summary_lines, summary_values
    from ..run.named_files import named_files
    from ..storage.run_files import refuse_written
    from ..transfer import Inputs

    person = int(subject) if subject is not None and subject.isdecimal() and not Path(subject).is_file() else subject
    inputs = Inputs(scene, reference, init, Path(person) if isinstance(person, str) else person, up_of(up))
    folder = resume or out or default_folder(scene, reference)
    if resume is None:  # what is resumed was begun so, or its journal refuses it
        configs = (config, *settings.origins.values())  # a file that another is based on too
        refuse_written(folder, [*named_files(inputs), *(Path(name) for name in configs if name)])
    shown = _run_into(folder, inputs, settings, allow_plugin or [], resume is not None, quiet)
    show(summary_values(folder, shown), summary_lines(folder, shown), as_json)
    taken = [f"no reference named: {reference} is taken"] if len(paths) == 1 else []
    tell([*taken, *unused_plugins(allow_plugin, settings)], as_json)


def _run_into(
    folder: Path, inputs: Inputs, settings: RunConfig, plugins: list[str], resumed: bool, quiet: bool
) -> ReportData:
    """Run a transfer, or go on with it, and write all that it leaves into ``folder``."""
    from ..computer.threads import default_count, set_threads
    from ..progress import progress
    from ..run.folder import write_run
    from ..storage.alone import alone
    from ..storage.run_files import DONE, JOURNAL, open_run
    from ..transfer import Record
    from ..transfer import transfer as run

    open_run(folder, resumed)
    record = Record(folder / JOURNAL, resumed)

    def way_on() -> str:
        begun = record.ours and not (folder / DONE).is_file()
        return f"the same command with --resume {shlex.quote(str(folder))} goes on from here" * begun

    with goes_on(way_on), alone(folder, "writes a run", "--resume" if resumed else "--out"):
        if not (resumed or quiet):
            _tell_replaced(folder)
        set_threads(settings.threads or default_count())  # of what is written too
        with progress(quiet) as report:
            result = run(inputs, settings, report, record)
            return write_run(folder, result, inputs, settings, plugins)


def _tell_replaced(folder: Path) -> None:
    """Say what becomes of the run in ``folder``, if there is one."""
    from ..storage.run_files import DONE, JOURNAL

    if (folder / DONE).is_file():
        print(f"note: the run in {folder} will be replaced (--out FOLDER keeps it)", file=sys.stderr)
    elif (folder / JOURNAL).is_file():  # its own command is refused, which shows when all is read: too late to say this
        way = f"which goes on with it by --resume {shlex.quote(str(folder))}"
        told = f"the unfinished run in {folder} will be replaced, unless this is its own command, {way}"
        print(f"note: {told}", file=sys.stderr)


def render(
    run: Annotated[Path, typer.Argument(help="Folder of a run.")],
    overrides: Annotated[
        list[str] | None,
        typer.Argument(metavar="KEY=VALUE", help="output_side=1280, renderer.NAME.OPTION=VALUE, threads=1."),
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


def export(
    path: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, or a trajectory.json.")],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            help="shot.py: a script that makes the camera in Blender, its zoom too. shot.usda: USD. shot.json: "
            "nerfstudio. A folder: COLMAP's text model; SuperSplat takes its images.txt, without roll and lens.",
        ),
    ],
    overrides: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="KEY=VALUE",
            help="output_side=1920: longer side of the picture [px], by default that of RUN's. A column or row is "
            "added where they are odd, as H.264 has to have it; not for COLMAP.",
        ),
    ] = None,
    fps: Annotated[
        float | None,
        typer.Option(
            help="Frames a second, up to 240, between those of the run too. Default: only those it has, numbered as "
            "fast as they come, or at 24 a second where fewer than 12 do."
        ),
    ] = None,
    y_up: Annotated[
        bool | None,
        typer.Option(help="Of .py, .usda: programs turn the scene's file, y to z. Default: where RUN's is glTF, OBJ."),
    ] = None,
) -> None:
    """Write the camera of RUN for other programs, with focal length and roll.

    cltransfer export run output_side=1920 --fps 24 --out shot.py

    Coordinates are those of the scene's file (of an .spz those of the .ply that it unpacks to), so that scene and
    camera meet where one program reads both. COLMAP and nerfstudio play cameras evenly: give --fps where times are
    uneven.
    """
    check_keys(overrides or [], ("output_side",), "a camera")
    side = settings_of(None, overrides, None).output_side if overrides else None
    from ..export.lens import rate_of
    from ..run.export import WORLDS, export_path

    written = export_path(path, out, fps, y_up, side)
    numbered = f", numbered at {fps or rate_of(written):.6g} frames/s" * (out.suffix.lower() in WORLDS)
    seconds, (width, height) = float(written.times[-1] - written.times[0]), written.camera.size
    print(f"{out}: {len(written)} cameras of {width}x{height} over {seconds:.2f} s{numbered}")


def split(arguments: list[str]) -> tuple[list[str], list[str]]:
    """Two paths at most, then key=value; a path that holds '=' must exist."""
    from ..config.layers import QUOTES, is_cut

    paths, overrides = [a for a in arguments if not is_override(a)], [a for a in arguments if is_override(a)]
    for word, after in pairwise(arguments):
        if after.startswith("=") and not os.path.exists(after):
            key = word.partition("=")[0]
            raise UsageError(
                "", key, f"expected key=value, got {word} {after}", f"no spaces go around the =: {key}=VALUE"
            )
    if len(paths) > 2:
        spaced = "no spaces go around the =" * any(word.endswith("=") for word in overrides)
        hint = QUOTES if any(map(is_cut, overrides)) else spaced
        raise UsageError("", paths[2], f"expected at most 2 paths, got {len(paths)}", hint)
    return paths, overrides
