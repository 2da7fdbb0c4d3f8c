"""The verb that makes a preference study, and analyses it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from ..errors import UsageError
from ..storage.files import check_out
from ..storage.foreign import OF_A_STUDY, refuse_foreign
from ..storage.pages import INDEX
from .shared import Json, show

READS = "--analyse answers/*.csv --key page.key.json"


def study(
    paths: Annotated[
        list[str],
        typer.Argument(
            metavar="RUN_A RUN_B",
            help="Run folders or clips, one of each method for a sample; or answers. CLIP#t=START,END is a part of "
            "one; images play at 24 a second unless FOLDER#fps=30 or times.json says.",
        ),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder of the page, or for the files of the analysis.")
    ] = None,
    method: Annotated[
        list[str] | None,
        typer.Option(help="Names of the methods, in the order of the runs (repeatable). Default A, B."),
    ] = None,
    reference: Annotated[
        list[str] | None,
        typer.Option(help="Reference clip of each sample, named as clips are (repeatable); runs know their own."),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(help="Seed of the shuffled names under which the videos are shown. Default 0.")
    ] = None,
    analyse: Annotated[
        bool, typer.Option("--analyse", help="Read the arguments as the CSV files that participants saved.")
    ] = False,
    key: Annotated[Path | None, typer.Option(help="The key beside the page, for --analyse.")] = None,
    as_json: Json = False,
) -> None:
    """Make a blinded two-choice page of runs, or analyse what people answered on it.

    cltransfer study ours/1 jaws/1 ours/2 jaws/2 --method ours --method jaws --out page

    cltransfer study --analyse answers/*.csv --key page.key.json

    The page opens from disk, asks the paper's three questions, and shows sides and order at random. Without people
    who answer it, it is no user study.
    """
    if out is not None:
        check_out(out)
    if analyse:
        _refuse({"--method": method, "--reference": reference, "--seed": seed}, "an analysis, only of a page")
        if key is None:
            raise UsageError("", "--key", "expected the key that was written beside the page")
        if out is not None:
            refuse_foreign(out, OF_A_STUDY)
        return _analyse([Path(path) for path in paths], key, out, as_json)
    for path in paths:
        if path.lower().endswith(".csv") and not Path(path).is_dir():
            raise UsageError(path, "", "expected a run folder or a clip, got a table", f"to read answers: {READS}")
    _refuse({"--key": key}, "a page, only of an analysis", f"to read answers: {READS}")
    if out is None:
        raise UsageError("", "--out", "expected a folder for the page")
    from ..study.build import Wanted, build_study, counted

    wanted = Wanted(tuple(paths), tuple(method or ("A", "B")), tuple(reference or ()), seed or 0)
    made, key_file = build_study(wanted, out)
    count, index, notes = len(made.items), str(out / INDEX), wanted.notes()
    values = {"page": index, "key": str(key_file), "study": made.name, "comparisons": count, "notes": notes}
    lines = [f"{index}: {counted(made)}", f"{key_file}: whose video is whose; keep it from them"]
    return show(values, "\n".join([*lines, *(f"note: {note}" for note in notes)]), as_json)


def _refuse(options: Mapping[str, object], of_what: str, hint: str = "") -> None:
    """Refuse those of ``options`` that were given: what is made has no use for them."""
    for name, value in options.items():
        if value is not None:
            raise UsageError("", name, f"changes nothing of {of_what}", hint)


def _analyse(files: list[Path], key: Path, out: Path | None, as_json: bool) -> None:
    from ..study.report import analyse, markdown, values, write_analysis

    found = analyse(files, key)
    if out is not None:
        write_analysis(out, found)
    show(values(found), "\n".join(markdown(found)), as_json)
