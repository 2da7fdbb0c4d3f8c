"""What taught a run: which clip, and which part of it, so that it is not held against another without a word."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from ..errors import InputError
from ..storage.files import read_json
from ..storage.run_files import FRAMES, MANIFEST, VIDEO, is_run, kept_frames
from .image_folder import FOLDER_RATE, clip_hash
from .source import KEYS, ClipSource

MOMENT = 1e-3  # [s]; nearer ones are one
REFERENCE = Path("REFERENCE")  # what stands for its name in a note


@dataclass(frozen=True)
class Lesson:
    """The reference of a run as its manifest tells it.

    Args:
        digest: of the clip.
        part: what was taken of it, as in ``t=1,2``; empty for all of it, None of a run of before parts were written.
    """

    digest: str
    part: str | None

    @classmethod
    def of(cls, run: Path) -> Lesson:
        """That of the folder of a run.

        Raises:
            InputError: its manifest is damaged.
        """
        manifest = read_json(run / MANIFEST)
        reference = manifest.get("reference", {}) if isinstance(manifest, dict) else None
        if not isinstance(reference, dict):
            raise InputError(run / MANIFEST, "reference", "is no manifest of a run", "make the run anew")
        part = reference.get("part")
        return cls(str(reference.get("sha256")), None if part is None else str(part))


def taught_otherwise(made: ClipSource, asked: ClipSource, shown: bool = False) -> ClipSource | None:
    """What to name in place of ``asked``, where another part of that clip, or another person in it, taught ``made``.

    Ends are not compared, what is shown after either is no wrong moment. Where a part of the run is ``made``, the
    moments are those of that part, and whom its persons are is not known.

    Args:
        made: the folder of a run, or a video of frames in it; anything else was not taught.
        asked: the clip that it is held against; one that is there.
        shown: whether it is only shown, so that neither whom it follows nor its bars matter.

    Raises:
        InputError: the manifest of the run is damaged.
    """
    run = _run_of(made.path)
    lesson = None if run is None else Lesson.of(run)
    if lesson is None or lesson.part is None:
        return None
    taught = _source(asked.path, lesson.part)
    start = taught.span[0] + made.span[0]
    same = abs(start - asked.span[0]) <= MOMENT
    wanted = replace(
        asked,
        span=asked.span if same else (start, min(taught.span[1], taught.span[0] + made.span[1])),
        fps=asked.fps if (asked.fps or FOLDER_RATE) == (taught.fps or FOLDER_RATE) else taught.fps,
    )
    if not shown:
        bars = (asked.letterbox == "keep") == (taught.letterbox == "keep")
        person = (asked.person or 0) == (taught.person or 0) or made.span[0] > 0
        wanted = replace(
            wanted,
            letterbox=asked.letterbox if bars else taught.letterbox,
            person=asked.person if person else taught.person,
        )
    if wanted == asked or clip_hash(kept_frames(asked.path)) != lesson.digest:  # which takes a second of a large file
        return None
    return wanted


def taught_notes(made: ClipSource, asked: ClipSource) -> tuple[str, ...]:
    """A note where a run is scored against other than what taught it; see :func:`taught_otherwise`."""
    wanted = taught_otherwise(made, asked)
    if wanted is None:
        return ()
    named = replace(wanted, path=REFERENCE).named
    return (f"taught by {named}, and scored against another part of it, rate or person: name that",)


def _run_of(path: Path) -> Path | None:
    """The folder of the run that ``path`` is, or whose frames it shows; None of any other clip."""
    folder = path.absolute().parent.parent
    if is_run(path):
        return path
    return folder if path.name in (FRAMES.name, VIDEO.name) and is_run(folder) else None


def _source(path: Path, part: str) -> ClipSource:
    """The ``part`` of a clip; all of it where what was told as one is the end of its name."""
    fragment = part.rpartition("#")[2]
    known = all(one.partition("=")[0] in KEYS for one in fragment.split("&"))
    return ClipSource.parse(f"{path}#{fragment}") if fragment and known else ClipSource(path)
