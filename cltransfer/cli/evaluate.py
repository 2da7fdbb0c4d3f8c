"""The verb that scores clips: one against another, or whole folders of several methods."""

from __future__ import annotations

import os
import shlex
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any

import typer

from ..errors import InputError, UsageError
from ..storage.foreign import OF_A_CLIP, OF_METHODS, refuse_foreign
from ..storage.run_files import refuse_run
from .shared import Allow, Config, Json, Quiet, check_keys, goes_on, settings_of, show, tell, unused_plugins

SCORING = ("frames", "renderer", "extractors", "losses", "threads", "preset")  # keys of the config that it looks at


def evaluate(
    reference: Annotated[
        str,
        typer.Argument(
            help="Video, image folder (24 images/s unless FOLDER#fps=30 or its times.json says) or run folder, "
            "CLIP#t=START,END for a part; or a folder of clips, FOLDER#t=START,END for that part of each."
        ),
    ],
    render: Annotated[
        str,
        typer.Argument(
            help="Video, image folder or run folder, named as REFERENCE is; its frames are paired by time. Where "
            "REFERENCE is a folder of clips: METHOD=FOLDER, of clips with the same names, or METHOD=FOLDER#fps=30 "
            "for all image folders in it."
        ),
    ],
    more: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="METHOD=FOLDER|KEY=VALUE",
            help="Further methods, where REFERENCE is a folder of clips; then what goes over the config: frames=24, "
            "extractors..., losses..., preset=, renderer..., threads=, and of folders seed= (`plugins show config`).",
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Folder for the results.")] = None,
    config: Config = None,
    allow_plugin: Allow = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Score the clip RENDER against the clip REFERENCE, or whole folders of clips; no scene is needed.

    Two networks read the clips; get them first, once: cltransfer models pull default

    cltransfer evaluate clip.mp4 render.mp4 --json

    cltransfer evaluate references/ ours=runs/ theirs=clips/ --out table

    With --out it leaves metrics.json, metrics.csv and report.html in that folder; of folders metrics.json, clips.csv
    and methods.csv, .md and .tex with bootstrap intervals over the clips, of six or more, and what each method differs
    by from the first, clip by clip. What was scored is kept in scores.jsonl there, so that the same command goes on
    where it was stopped.
    """
    methods, overrides = methods_of(reference, render, more or [])
    settings = settings_of(config, overrides, allow_plugin)
    check_keys(overrides, (*SCORING, "seed") if methods else SCORING, "the scores")
    if out is not None:
        refuse_run(out, "metrics and report", "scores")
        _refuse_other_scores(out, bool(methods))
        refuse_foreign(out, OF_METHODS if methods else OF_A_CLIP, ("methods.md", "methods.tex") if methods else ())
    from ..computer.threads import set_threads, thread_count

    set_threads(settings.threads or thread_count())
    if methods:
        evaluate_folders(reference, methods, settings, out, as_json, quiet)
    else:
        evaluate_clips(reference, render, settings, out, as_json, quiet)
    tell(unused_plugins(allow_plugin, settings), as_json)


def _refuse_other_scores(out: Path, folders: bool) -> None:
    """Refuse a folder with scores of the other kind: a part of them would be replaced, and the rest stay beside."""
    of_folders = any((out / name).is_file() for name in ("methods.csv", "scores.jsonl"))
    if folders and not of_folders and (out / "metrics.csv").is_file():
        raise UsageError(
            out, "--out", "holds the scores of one clip, of which a part would stay", "name another folder"
        )
    if of_folders and not folders:
        raise UsageError(out, "--out", "holds the scores of folders, of which a part would stay", "name another folder")


def evaluate_clips(reference: str, render: str, settings: Any, out: Path | None, as_json: bool, quiet: bool) -> None:
    """Score one clip and show its metrics and what a reader should know."""
    from ..evaluate import evaluate as run
    from ..progress import progress
    from ..report.metrics import metrics_json, metrics_table, number, write_metrics
    from ..report.page import write_report

    with progress(quiet) as report:
        shown = run(reference, render, settings, report)
    if out is not None:
        write_metrics(out, shown)
        write_report(out, shown)
    notes = [*shown.notes]
    if shown.apart is not None:
        grows = ", with which camera movement grows" * (shown.scores.term("camera_movement") is not None)
        notes.append(f"scored frames are {number(shown.apart)} s apart{grows}")
    lines = [metrics_table(shown), *(f"note: {note}" for note in notes)]
    show(metrics_json(shown), "\n".join(lines), as_json)


def methods_of(reference: str, render: str, more: list[str]) -> tuple[dict[str, str], list[str]]:
    """Folders to be compared with the clips in ``reference``, by method, and the arguments left; none for one clip.

    Raises:
        UsageError: a folder is not there or named twice, has no name before its =, or is one of a method where
            ``reference`` is one clip.
    """
    if _is_one_clip(_folder(reference)):
        _check_one_render(reference, render)
        _check_no_second(reference, more)
        return {}, more
    methods: dict[str, str] = {}
    rest = []
    for argument in (render, *more):
        name, path = _method(argument)
        if path and not name.strip():
            raise UsageError(argument, "", "expected the name of a method before the =", "METHOD=FOLDER")
        if path and os.path.isdir(_folder(path)):
            if name in methods:
                raise UsageError("", name, "two methods have this name", "name them: METHOD=FOLDER")
            methods[name] = path
        elif path and (file := _file(path)):
            hint = f"name the folder that it lies in: {shlex.quote(f'{name}={file.parent}')}"
            raise UsageError(argument, "", f"{file} is a file, expected a folder of clips, as {reference} is one", hint)
        elif path:
            raise UsageError(argument, "", f"no such folder, and {name!r} is no key of the config", _nearest_key(name))
        elif argument is render:
            hint = (
                f"{name!r} is a key of the config: give the method another name"
                if _of_config(name)
                else "METHOD=FOLDER"
            )
            raise UsageError(render, "", "expected a folder of clips, as the reference is one", hint)
        else:
            rest.append(argument)
    return methods, rest


def _folder(argument: str) -> str:
    """``argument`` without what is asked of the clips in a folder, which may stand behind its name."""
    name, mark, _ = argument.rpartition("#")
    return name if mark and not os.path.exists(argument) else argument


def _is_one_clip(named: str) -> bool:
    """Whether what is ``named`` is one clip, and no folder of them."""
    from ..clips.image_folder import holds_clips
    from ..storage.run_files import is_run

    path = Path(named)
    return not path.is_dir() or is_run(path) or not holds_clips(path)


def _file(named: str) -> Path | None:
    """The file that is ``named``, perhaps with a part behind it."""
    return next((Path(name) for name in (named, named.rpartition("#")[0]) if os.path.isfile(name)), None)


def _check_one_render(reference: str, render: str) -> None:
    """Refuse several clips, or a method, where the reference is one clip, saying by what it is one."""
    path = _file(reference) or Path(_folder(reference))
    if not path.exists():
        return
    clips, named = _folder(render), _method(render)[1]
    if os.path.isdir(clips):
        if not _is_one_clip(clips):
            reason = f"holds clips, expected one, as {reference} {_by_what(path)}"
            raise UsageError(render, "", reason, f"{_one_of(clips, path)}; or a folder as REFERENCE too")
    elif named and not os.path.exists(render):
        if _file(named):
            reason = f"expected one render, and no method, as {reference} {_by_what(path)}"
            raise UsageError(render, "", reason, f"METHOD= goes with folders only: {shlex.quote(named)}")
        if os.path.isdir(_folder(named)):
            reason = f"{_by_what(path)}, so it is taken for one clip: expected one render, got {render}"
            hint = "leave out METHOD=, or name a folder that holds videos, image folders or runs, and no images"
            raise UsageError(reference, "", reason, hint)


def _check_no_second(reference: str, more: list[str]) -> None:
    """Refuse a second clip behind the render of one."""
    for argument in more:
        if _file(argument) or os.path.isdir(_folder(argument)):
            hint = "score one after the other, or folders: evaluate REFERENCES METHOD=FOLDER METHOD=FOLDER"
            raise UsageError(argument, "", f"expected one render, as {reference} is one clip", hint)


def _by_what(path: Path) -> str:
    """By what a ``path`` is one clip."""
    from ..clips.image_folder import image_files
    from ..storage.run_files import is_run

    return "is a file" if path.is_file() else "is a run" if is_run(path) else f"holds {image_files(path)[0].name}"


def _one_of(folder: str, reference: Path) -> str:
    """Which clip of a folder of them may be meant: the one that is called as the ``reference``, or else the first."""
    from ..clips.clip_folder import clips_in

    clips = clips_in(Path(folder))
    return f"name one, as {shlex.quote(str(clips.get(reference.stem) or next(iter(clips.values()))))}"


def _method(argument: str) -> tuple[str, str]:
    """Name and folder of a method, as in METHOD=FOLDER or by the folder alone; no folder where it is an override."""
    if os.path.isdir(_folder(argument)):  # no error of a text that is too long for a path
        return Path(_folder(argument)).name, argument
    name, _, path = argument.partition("=")
    return (name, "") if _of_config(name) else (name, path)


def _of_config(name: str) -> bool:
    """Whether ``name=`` begins an override, even where a folder is called like its value."""
    return name.partition(".")[0] in {"base", *_keys()}


def _keys() -> list[str]:
    from ..config.options import RunConfig

    return [field.name for field in fields(RunConfig)]


def _nearest_key(name: str) -> str:
    from ..registry.typed import nearest

    return nearest(name, _keys())


def evaluate_folders(
    references: str, methods: dict[str, str], settings: Any, out: Path | None, as_json: bool, quiet: bool
) -> None:
    """Score folders of clips and show the table of methods and what a reader should know."""
    from ..clips.clip_folder import left_over
    from ..evaluate_kept import KEPT
    from ..evaluate_many import evaluate_many, notes_of, summarise, worst_of
    from ..evaluate_paired import differences
    from ..evaluate_table import methods_json, methods_markdown, write_methods
    from ..progress import progress

    def way_on() -> str:
        return f"the same command goes on from here: {out}" * (out is not None and (out / KEPT).is_file())

    with goes_on(way_on), progress(quiet) as report:
        rows = evaluate_many(references, methods, settings, report, out)
        summary = summarise(rows, settings.seed, worst_of(settings, rows))
        against = differences(rows)
        unknown = left_over(references, methods)
        if out is not None:
            write_methods(out, rows, summary, against, unknown)
    lacking = [f"{row.method}, {row.clip}: {row.reason}" for row in rows if row.reason]
    notes = [f"note: {note}" for note in [*notes_of(rows), *unknown]]
    lines = [methods_markdown(summary, against), *lacking, *notes]
    show(methods_json(rows, summary, against, unknown), "\n".join(lines), as_json)
    if not any(row.means for row in rows):
        reason = f"expected one that can be scored, {len(rows)} failed; the first: {rows[0].reason}"
        raise InputError(references, "clips", reason)
