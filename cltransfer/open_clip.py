"""A clip made fit to be read: one shot, without bars, with what was done to it said."""

from __future__ import annotations

from dataclasses import replace

from .clip import Clip, read_clip
from .clip_source import ClipSource
from .cuts import check_one_shot
from .letterbox import cropped, find_letterbox


def open_clip(where: ClipSource, frames: int | None = None) -> tuple[Clip, tuple[str, ...]]:
    """Read ``where``, evenly thinned to ``frames``.

    Returns:
        The clip, and what a reader should know of it.

    Raises:
        InputError: it is missing or damaged, or has a cut.
    """
    clip = read_clip(where.path, frames, span=where.span)
    if where.cuts == "refuse":
        check_one_shot(where.path, where.span)
    if where.letterbox == "keep":
        return clip, ()
    picture = find_letterbox(clip.image)
    width, height = picture[2] - picture[0], picture[3] - picture[1]
    if (width, height) == clip.size:
        return clip, ()
    was = f"{clip.size[0]}x{clip.size[1]}"
    flag = f"black bars cropped: {was} to {width}x{height} at {picture[0]}, {picture[1]} (#letterbox=keep keeps them)"
    return replace(clip, image=cropped(clip.image, picture)), (flag,)
