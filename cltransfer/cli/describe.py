"""Verbs that read a clip for a person: describe it in words, or lay its reading open to the eye."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..describe.camera_path import camera_path
from ..reading.scene_source import is_scene
from ..storage.files import check_out, write_json, write_text
from ..storage.pages import check_page
from .shared import Allow, Config, Json, Overrides, Quiet, check_keys, settings_of, show

# keys of the config that a reading looks at, by what is read
STORED = ("frames", "losses", "threads", "preset")
READING = {
    "a scene with a trajectory": (*STORED, "extractors", "renderer", "output_side"),
    "a clip": (*STORED, "extractors"),
    "a feature file": STORED,
    "a camera path": ("frames",),
}


def describe(
    source: Annotated[
        str, typer.Argument(help="A clip as in `transfer`, the folder of a run, or a trajectory.json with its person.")
    ],
    overrides: Overrides = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Folder for the results.")] = None,
    subject: Annotated[Path | None, typer.Option(help="subject.json of the person a trajectory films.")] = None,
    config: Config = None,
    allow_plugin: Allow = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Say in a cinematographer's words what SOURCE is: shot size, angle, movement, staging.

    cltransfer describe clip.mp4 frames=12 --out words

    Two networks read a clip; get them first, once: cltransfer models pull default

    With --out it leaves description.json, description.txt and strip.svg in that folder.
    """
    settings = settings_of(config, overrides or [], allow_plugin)
    kind = "a camera path" if camera_path(source) is not None else _kind(source)
    check_keys(overrides or [], READING[kind], f"a description of {kind}")
    if out is not None:
        check_out(out)
    from ..computer.threads import set_threads, thread_count
    from ..describe.sources import describe as run
    from ..describe.strip import write_strip
    from ..progress import progress

    set_threads(settings.threads or thread_count())  # of what is written too
    with progress(quiet) as report:
        found, image = run(source, settings, subject, report)
    text = "\n".join([found.text(), *(f"note: {flag}" for flag in found.flags)])
    if out is not None:
        write_json(out / "description.json", found.to_json())
        write_text(out / "description.txt", text + "\n")
        write_strip(out / "strip.svg", found, image)
    show(found.to_json(), text, as_json)


def _kind(source: str) -> str:
    """What is read of a ``source`` that is no camera path, as :data:`READING` calls it."""
    if is_scene(source):
        return "a scene with a trajectory"
    return "a feature file" if source.endswith(".safetensors") else "a clip"


def inspect(
    source: Annotated[str, typer.Argument(help="A clip as in `transfer`.")],
    overrides: Overrides = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the page.")] = Path("inspection"),
    config: Config = None,
    allow_plugin: Allow = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Lay open what is read in a clip: a page with every frame's joints, layers, flow and angle drawn over it.

    cltransfer inspect clip.mp4 frames=12 --out page

    Two networks read a clip; get them first, once: cltransfer models pull default
    """
    settings = settings_of(config, overrides or [], allow_plugin)
    kind = _kind(source)
    check_keys(overrides or [], READING[kind], f"an inspection of {kind}")
    from ..report.inspection_page import MARK

    check_page(out, MARK, "a page of `inspect`")
    from ..computer.threads import set_threads, thread_count
    from ..inspect_clip import inspect_clip, write_inspection
    from ..progress import progress

    set_threads(settings.threads or thread_count())  # of what is written too
    with progress(quiet) as report:
        found = inspect_clip(source, settings, report)
    page = write_inspection(out, found)
    count = len(found.reference)
    coverage = {term.name: {"defined": term.defined, "reason": term.reason} for term in found.scores.terms}
    flags = list(found.reference.flags)
    values = {
        "page": str(page),
        "frames": count,
        "person": found.seen,
        "confidence": [round(value, 4) for value in found.confidence.tolist()],
        "terms": coverage,
        "seconds": round(found.seconds, 2),
        "flags": flags,
    }
    terms = ", ".join(f"{term.name} {term.defined}" for term in found.scores.terms)
    lines = [f"{page}: the person in {found.seen} of {count} frames; {terms}", *(f"note: {flag}" for flag in flags)]
    show(values, "\n".join(lines), as_json)
