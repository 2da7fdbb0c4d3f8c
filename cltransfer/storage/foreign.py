"""Files that a verb would write, but somebody else has: they are not written over."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from ..errors import UsageError
from .run_files import LABELS, METRICS, METRICS_CSV, REPORT, SUBJECT

HEAD = 4096  # bytes of a file within which it is seen who has written it
OF_A_CLIP = {  # marks of what was written here, by every version so far
    METRICS: '"format": "cltransfer.metrics"',
    METRICS_CSV: "frame,time,",
    REPORT: "default-src 'none'; img-src data:; style-src 'unsafe-inline'",
}
OF_METHODS = {
    METRICS: '"format": "cltransfer.methods"',
    "clips.csv": "method,clip,frames,",
    "methods.csv": "method,term,",
}
OF_A_PERSON = {SUBJECT: '"format": "cltransfer.subject"', LABELS: '"label"'}
OF_A_STUDY = {
    "analysis.json": '"format": "cltransfer.study-analysis"',
    "analysis.md": "two choices, sides and order random",
    "preferences.csv": "question,first,second,",
}


def refuse_foreign(folder: Path, marks: Mapping[str, str], beside: Sequence[str] = ()) -> None:
    """Refuse a ``folder`` in which a file lies that would be replaced and that was not written here.

    Args:
        folder: there or not.
        marks: by the name of a file what stands within its head if it was.
        beside: names of files that have no mark, and are ours where one that has lies there too.

    Raises:
        UsageError: there is such a file.
    """
    ours = [name for name in marks if (folder / name).is_file()]
    for name in ours:
        if (folder / name).stat().st_size and not head_holds(folder / name, marks[name]):
            raise _foreign(folder / name)
    for name in beside:
        if not ours and (folder / name).is_file():
            raise _foreign(folder / name)


def head_holds(file: Path, mark: str) -> bool:
    """Whether ``mark`` stands within the head of a file that is there."""
    with file.open("rb") as stream:
        return mark.encode() in stream.read(HEAD)


def _foreign(file: Path) -> UsageError:
    hint = "name another folder, or take it away first"
    return UsageError(file, "--out", "is there, and was not written by this verb", hint)
