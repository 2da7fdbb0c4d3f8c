"""What a run has kept, as a clip: its frames from its video, which counts milliseconds, their times from its path."""

from __future__ import annotations

from dataclasses import replace

from ..storage.files import content_hash
from ..storage.run_files import TRAJECTORY, kept_frames
from .image_folder import clip_hash
from .source import ClipSource


def kept_clip(where: ClipSource) -> ClipSource:
    """``where``, or of a run the frames that it has kept; where it has lost its trajectory they play as its video does.

    Raises:
        InputError: the run has not come to its end, or a part of it leads elsewhere.
    """
    video, path = kept_frames(where.path), where.path / TRAJECTORY
    if video == where.path:
        return where
    return replace(where, path=video, trajectory=path if path.is_file() else None)


def kept_hash(where: ClipSource) -> str:
    """SHA-256 of what is played of the whole of ``where``, as :func:`kept_clip` has it, and of what tells when."""
    return clip_hash(where.path) + ("" if where.trajectory is None else content_hash(where.trajectory))
