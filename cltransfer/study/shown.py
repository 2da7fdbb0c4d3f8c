"""What a study shows: the frames of clips and of runs, and the reference that the runs of a sample share."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from ..clips.clip import read_clip
from ..clips.image_folder import clip_hash
from ..clips.kept_clip import kept_clip
from ..clips.open_clip import open_clip
from ..clips.part import HINT
from ..clips.source import ClipSource
from ..clips.taught import MOMENT, Lesson, taught_otherwise
from ..errors import InputError, ResourceError, UsageError
from ..report.side_by_side import reference_side
from ..storage.files import read_json
from ..storage.run_files import BESIDE, FRAMES, METRICS, TRAJECTORY, is_run, kept_frames, require_done
from ..trajectory import Trajectory

SHEET_SIDE = 8192  # a sheet is cut where it was put together, so it is read as large as it is [px]
SHORTER = "cut it, #t=START,END"
NAME_IT = "name the reference: --reference CLIP"


@dataclass(frozen=True)
class Shown:
    """A video to show: frames (N, 3, H, W) uint8 at times (N,) [s], and what they were read from."""

    image: Tensor  # (N, 3, H, W)
    times: Tensor  # (N,)
    named: str


def source_of(source: str | Path) -> ClipSource:
    """A run folder or a clip that is there, and which part of it is shown.

    Raises:
        UsageError: a part is named that a study cannot show.
        InputError: there is none, or it is a run that has not come to its end.
    """
    where = ClipSource.parse(str(source))
    if not where.path.exists():
        raise InputError(where.path, "", "no such file or folder")
    if where.person is not None:
        raise UsageError(source, "#person", "expected a whole clip, a study follows nobody", "leave out #person")
    require_done(where.path)
    return where


def kept(where: ClipSource) -> ClipSource:
    """``where``, or of a run the frames that it has kept."""
    return replace(where, path=kept_frames(where.path))


def digest_of(where: ClipSource) -> str:
    """Of what is shown: of another part of the same clip, another; of a run nothing else that lies in its folder."""
    part = replace(where, path=Path())
    shown = [where.path / name for name in (FRAMES, BESIDE)] if is_run(where.path) else [where.path]
    content = "".join(clip_hash(path) for path in shown if path.exists())
    return content + ("" if part == ClipSource(Path()) else str(part))


def clip_of(where: ClipSource) -> Shown:
    """The frames of a run folder, as they were kept, or of a clip.

    Raises:
        InputError: they cannot be read, are too many, or some were cut off.
        ResourceError: they do not fit in memory.
    """
    as_is = replace(kept_clip(where), letterbox=where.letterbox or "keep", cuts=where.cuts or "keep")
    with _advised(SHORTER):
        clip, _ = open_clip(as_is)
    if is_run(where.path) and replace(where, letterbox=None, cuts=None) == ClipSource(where.path):
        _check_whole(where.path, len(clip.times), kept_frames(where.path))
    return Shown(clip.image, clip.times, where.named)


@contextmanager
def _advised(hint: str) -> Iterator[None]:
    """Refusals of a clip that is too large advise this ``hint``: a study has no ``frames=N``."""
    try:
        yield
    except (InputError, ResourceError) as error:
        if HINT not in error.hint:
            raise
        raise type(error)(error.where, error.field, error.reason, error.hint.replace(HINT, hint)) from None


def _check_whole(run: Path, count: int, video: Path) -> None:
    """Refuse a run whose ``video`` was cut off: its ``count`` frames look like a shorter clip."""
    metrics = read_json(run / METRICS) if (run / METRICS).is_file() else {}
    frames = metrics.get("frames", count) if isinstance(metrics, dict) else count
    if frames != count:
        raise InputError(video, "video", f"has {count} frames, its run {frames}", "make the run anew")


def reference_of(group: Sequence[ClipSource], given: ClipSource | None) -> Shown:
    """The reference of one sample: ``given``, or the one that the runs of ``group`` share and keep.

    Raises:
        UsageError: none is given of clips, or of parts of runs, or other moments of it taught one.
        InputError: it cannot be read, or the runs have different ones.
    """
    if given is not None:
        for where in group:
            if (taught := taught_otherwise(where, given, shown=True)) is not None:
                reason = f"other moments of it taught {where.named}"
                raise UsageError(given.named, "--reference", reason, f"name {shlex.quote(taught.named)}")
        return clip_of(given)
    if not all(is_run(where.path) for where in group):
        raise UsageError("", "--reference", "clips do not know theirs", "name one for each sample")
    if any(where != ClipSource(where.path) for where in group):
        raise UsageError("", "--reference", "a part of a run does not know its own", "name it: --reference CLIP#t=1,2")
    return _own_reference([where.path for where in group])


@dataclass(frozen=True)
class _Taught:
    """What taught a run, and when its frames are shown.

    A manifest of before parts were written knows neither part nor times.
    """

    by: Lesson
    times: Tensor | None  # (N,) [s]

    def other(self, than: _Taught) -> bool:
        """Whether the two are known to differ."""
        if self.by.digest != than.by.digest:
            return True
        if self.times is None or than.times is None:
            return False
        alike = self.times.shape == than.times.shape and torch.allclose(self.times, than.times, rtol=0, atol=MOMENT)
        return self.by.part != than.by.part or not alike


def _taught_by(run: Path) -> _Taught:
    """What taught ``run``, as its manifest and its trajectory say."""
    lesson = Lesson.of(run)
    return _Taught(lesson, None if lesson.part is None else Trajectory.load(run / TRAJECTORY).times)


def _own_reference(group: Sequence[Path]) -> Shown:
    """The one reference of the runs of ``group``, which keep it beside their results."""
    first = _taught_by(group[0])
    for run in group[1:]:
        if _taught_by(run).other(first):
            hint = "runs of one sample share a reference, the part of it and its moments"
            raise InputError(run, "reference", f"is not that of {group[0]}", hint)
    sheet = group[0] / BESIDE
    if not sheet.is_file():
        raise InputError(sheet, "", "no such file", NAME_IT)
    with _advised(NAME_IT):
        clip = read_clip(sheet, max_side=SHEET_SIDE)
    _check_whole(group[0], len(clip.times), sheet)
    return Shown(reference_side(clip.image), clip.times, str(sheet))
