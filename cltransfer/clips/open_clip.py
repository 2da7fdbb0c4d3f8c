"""A clip made fit to be read: one shot, without bars, with what was done to it said."""

from __future__ import annotations

from dataclasses import replace

from torch import Tensor

from .clip import Clip, clip_of
from .cuts import check_one_shot
from .image_folder import FOLDER_RATE, TIMES, untimed
from .letterbox import cropped, find_letterbox
from .part import ClipPart, find_part
from .source import ClipSource
from .thinned import evenly

APART = 1.0  # [s] between frames, above which what moved cannot be followed
ASSUMED = f"frames without {TIMES} are taken to play at {FOLDER_RATE:g} images/s: name another rate as FOLDER#fps=N"


def open_clip(where: ClipSource, frames: int | None = None) -> tuple[Clip, tuple[str, ...]]:
    """Read ``where``, evenly thinned to ``frames``.

    Returns:
        The clip, and what a reader should know of it.

    Raises:
        InputError: it is missing or damaged, or has a cut.
        ResourceError: its frames do not fit in memory.
        UsageError: images a second are named for what has times of its own.
    """
    part = find_part(where.path, where.span, where.fps, where.trajectory)
    return open_part(where, part, evenly(part.times, frames))


def open_part(where: ClipSource, part: ClipPart, kept: Tensor) -> tuple[Clip, tuple[str, ...]]:
    """The frames of ``part`` that are ``kept``, (K,) int64, as ``where`` asks for them; see :func:`open_clip`."""
    clip = clip_of(part, kept)
    gaps = check_one_shot(where, part) if where.cuts != "keep" else ()
    flags = (*gaps, *([ASSUMED] if rate_assumed(where) else []), *_sparse(clip), *clip.notes)
    if where.letterbox == "keep":
        return clip, flags
    shown, bars = without_bars(clip)
    return shown, (*bars, *flags)


def without_bars(clip: Clip) -> tuple[Clip, tuple[str, ...]]:
    """The clip without black bars, and what was cropped; nothing where it has none."""
    picture = find_letterbox(clip.image)
    width, height = picture[2] - picture[0], picture[3] - picture[1]
    if (width, height) == clip.size:
        return clip, ()
    was = f"{clip.size[0]}x{clip.size[1]}"
    flag = f"black bars cropped: {was} to {width}x{height} at {picture[0]}, {picture[1]} (#letterbox=keep keeps them)"
    return replace(clip, image=cropped(clip.image, picture)), (flag,)


def rate_assumed(where: ClipSource) -> bool:
    """Whether nothing says how fast the images of ``where`` play."""
    return where.fps is None and untimed(where.path)


def _sparse(clip: Clip) -> tuple[str, ...]:
    """A flag where frames are so far apart that motion between them is a guess."""
    if len(clip.times) < 2:
        return ()
    apart = float(clip.times.diff().median())
    if apart <= APART:
        return ()
    return (f"frames are {apart:.1f} s apart: motion, and who is who, are uncertain (more frames=, or #t=START,END)",)
