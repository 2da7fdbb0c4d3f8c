"""What lies in a run folder, by name, and whether the run in it has come to its end."""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Iterable
from pathlib import Path

from ..errors import InputError, UsageError
from .files import check_out, read_json, refuse_outside, same_file
from .unfinished import clear_left, holds_others

FORMAT = "cltransfer.run"  # what the manifest of a run says it is
MANIFEST, CONFIG, JOURNAL, DONE = "manifest.json", "config.yaml", "journal.bin", "DONE"
TRAJECTORY, CAMERA_PATH = "trajectory.json", Path("camera") / "camera_path.json"
SUBJECT, LABELS = "subject.json", "labels.safetensors"  # the person, beside a scene too
METRICS, METRICS_CSV, REPORT = "metrics.json", "metrics.csv", "report.html"  # an evaluation leaves them too
FRAMES = Path("video") / "frames.mkv"  # lossless
VIDEO = Path("video") / "render.mp4"
BESIDE = Path("video") / "side_by_side.mp4"
STRIP = "strip.jpg"
RESULTS = (
    DONE, MANIFEST, CONFIG, TRAJECTORY, CAMERA_PATH, FRAMES, VIDEO, BESIDE, STRIP, SUBJECT, LABELS,
    METRICS, METRICS_CSV, REPORT,
)  # fmt: skip


def is_run(folder: Path) -> bool:
    """Whether ``folder`` is that of a run, finished or not; other programs have files of these names too."""
    return _is_journal(folder / JOURNAL) or _is_manifest(folder / MANIFEST)


def _is_journal(path: Path) -> bool:
    """Whether its header is the JSON of a journal, or was not written when the run was killed."""
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        return b'{"'.startswith(stream.read(10)[8:])  # behind length and checksum


def _is_manifest(path: Path) -> bool:
    if not path.is_file():
        return False
    try:
        told = read_json(path)
    except InputError:
        return False
    return isinstance(told, dict) and told.get("format") == FORMAT


def require_run(folder: Path, expected: str = "the folder of a run") -> None:
    """Refuse a folder that only looks like that of a run: it may hold links, and is written into.

    Raises:
        InputError: it has no manifest, or another program's; the line tells what was ``expected``.
    """
    if not is_run(folder):
        reason = "is no run's" if (folder / MANIFEST).is_file() else "no such file"
        raise InputError(folder, MANIFEST, reason, f"expected {expected}")


def refuse_run(folder: Path, what: str, inside: str) -> None:
    """Refuse the folder of a run for a result whose ``what`` the run has too; ``inside`` it there would be room.

    Raises:
        UsageError: it is one, or no folder.
    """
    check_out(folder)
    if is_run(folder):
        reason = f"expected another folder than that of a run, whose own {what} have the same names"
        raise UsageError(folder, "--out", reason, f"as in --out {shlex.quote(str(folder / inside))}")


def require_done(folder: Path) -> None:
    """Refuse a run that was killed: what lies there is of an earlier run, or not whole.

    Raises:
        InputError: ``folder`` is a run that has not come to its end, or a part of it leads elsewhere.
    """
    if not is_run(folder):
        return
    _refuse_links(folder)
    if not (folder / DONE).is_file():
        raise InputError(
            folder, DONE, "this run was not finished", "go on with it: cltransfer transfer ... --resume RUN"
        )


def kept_frames(path: Path) -> Path:
    """The clip to look at: the frames that the run in ``path`` has kept, or ``path`` itself where it is no run.

    Raises:
        InputError: the run has not come to its end, or a part of it leads elsewhere.
    """
    require_done(path)
    return path / FRAMES if is_run(path) else path


def kept_by_runs(out: Path, *folders: Path) -> list[Path]:
    """Results, there or not, of those of ``folders`` that are runs, and of those that ``out`` would lie in."""
    around = Path(os.path.realpath(out)).parents[:2]  # as deep as a result lies in its run
    return [folder / name for folder in (*folders, *around) if is_run(folder) for name in RESULTS]


def open_run(folder: Path, resume: bool = False) -> Path:
    """``folder``, as one that a run can be written into.

    Raises:
        UsageError: there is something else in it, or nothing to resume.
        InputError: a part of it leads elsewhere.
    """
    check_out(folder)
    _refuse_links(folder)
    if resume and not (folder / JOURNAL).is_file():
        raise UsageError(folder, "--resume", f"expected the folder of a run, it has no {JOURNAL}", "begin one: --out")
    if not is_run(folder) and holds_others(folder, re.compile(re.escape(MANIFEST))):
        option = "--resume" if resume else "--out"
        raise UsageError(folder, option, "is neither empty nor a run", "name another folder")
    return folder


def _refuse_links(folder: Path) -> None:
    """Refuse parts of a run that are links out of it."""
    refuse_outside(folder, (folder / name for name in (JOURNAL, *RESULTS)), "run")


def refuse_written(folder: Path, read: Iterable[Path]) -> None:
    """Refuse to begin a run in ``folder`` that would replace what it is ``read`` from: once killed it could not go on.

    Raises:
        UsageError: one of those paths is the folder, or a file in it that runs write.
    """
    written = [folder / name for name in ("", JOURNAL, *RESULTS)]
    for path in read:
        if any(same_file(path, name) for name in written):
            raise UsageError(path, "", "this run reads it and would replace it", "name another --out")


def clear(folder: Path) -> None:
    """Take away what an earlier run has left in ``folder``, first what says that it is whole.

    What of it was being written when the run was killed goes too. Its manifest stays, by which the folder is known as
    that of a run until there is another.
    """
    for path in (folder / name for name in RESULTS):
        if path != folder / MANIFEST:
            path.unlink(missing_ok=True)
        clear_left(path.parent, re.compile(re.escape(path.name)))
