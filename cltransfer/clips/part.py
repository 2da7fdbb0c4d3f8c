"""A clip, or a part of it, before any of its frames is kept: when they are shown, and how some of them are read."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..computer.memory import require_free
from ..errors import InputError, UsageError
from ..trajectory import Trajectory
from .alpha import TRANSPARENT, is_transparent
from .decoding import decode
from .frame import SMALL, Frame
from .image_folder import folder_times, image_files

FRAME_LIMIT = 2000  # frames kept in memory
BYTE_LIMIT = 4 * 2**30  # of all frames kept
CUT = "take a part, of a clip by #t=START,END"
HINT = "keep fewer of them, frames=N, or cut the clip, #t=START,END"
_TICK = 0.00051  # [s] by which a time may miss the ends of a span, which are named to a millisecond


@dataclass(frozen=True, eq=False)
class ClipPart:
    """Frames of a file that may be read.

    Args:
        path: a video or a folder of images.
        files: the images of a folder that they are, (N,); empty for a video.
        index: number of each in the file, (N,) int64.
        times: when each is shown after the first frame of the file, (N,) float64 [s], increasing.
        glanced: small pictures of a video's, taken when their times were, (N, h, w, 3) uint8; None of a folder.
    """

    path: Path
    files: tuple[Path, ...]
    index: Tensor  # (N,)
    times: Tensor  # (N,) [s]
    glanced: np.ndarray | None = None

    def small(self) -> np.ndarray:
        """Small pictures of all of them, (N, h, w, 3) uint8; see :meth:`.Frame.small`.

        Raises:
            InputError: an image of a folder is damaged or of another size.
        """
        return _glances(images_of(list(self.files))) if self.glanced is None else self.glanced

    def check_kept(self, count: int) -> None:
        """Refuse to keep ``count`` frames if they are too many.

        Raises:
            InputError: they are.
        """
        if count > FRAME_LIMIT:
            raise InputError(self.path, "frames", f"expected at most {FRAME_LIMIT} to keep, got {count}", HINT)

    def images(self, kept: Sequence[int], max_side: int) -> tuple[Tensor, tuple[str, ...]]:
        """RGB of those that are ``kept``, (K, 3, H, W) uint8, and notes on them.

        Args:
            kept: which, increasing.
            max_side: larger frames are averaged down to this longer side [px].

        Raises:
            InputError: one is damaged, or they are too many.
            ResourceError: they do not fit in memory.
        """
        self.check_kept(len(kept))
        if self.files:
            chosen = images_of([self.files[k] for k in kept])
        else:
            chosen = _video_frames(self.path, set(self.index[list(kept)].tolist()))
        return _stack(self.path, chosen, len(kept), max_side)


def find_part(path: Path, span: tuple[float, float], fps: float | None, trajectory: Path | None = None) -> ClipPart:
    """The frames of a clip that are shown within ``span`` [s] after its first, both included.

    Args:
        path: a video, or a folder that plays as its ``times.json`` says (a list of seconds, one per image).
        span: from when to when.
        fps: images a second of a folder without ``times.json``; None takes 24.
        trajectory: what tells when the frames of a run's video are shown.

    Raises:
        InputError: the clip is missing, damaged or cut off, or shows no frame then.
        UsageError: ``fps`` is given for a clip that has times of its own.
    """
    files = files_of(path, fps)
    times, small = (folder_times(path, files, fps), None) if files else _looked_through(path, trajectory)
    times = times - times[0]
    inside = within(times, span)
    if len(inside) == 0:
        when = f"between {span[0]:g} and {span[1]:g} s" if span[1] < math.inf else f"from {span[0]:g} s on"
        raise InputError(path, "t", f"no frame {when}: the clip ends at {times[-1]:.3f} s")
    shown = tuple(files[i] for i in inside) if files else ()
    glanced = None if small is None else small[inside]
    return ClipPart(path, shown, torch.from_numpy(inside), torch.from_numpy(times[inside]), glanced)


def _looked_through(path: Path, trajectory: Path | None) -> tuple[np.ndarray, np.ndarray]:
    """When the frames of a video are shown, (N,) increasing [s], and small pictures of them, (N, h, w, 3) uint8.

    A run's ``trajectory`` tells the times of its own video.
    """
    stamps = array("d")
    small = _glances(_stamped(decode(path), stamps))
    times = np.array(stamps)
    if trajectory is None:
        return times, small
    told = Trajectory.load(trajectory).times.numpy()
    if len(told) != len(times):
        reason = f"expected {len(told)} as in {trajectory.name}, got {len(times)}"
        raise InputError(path, "frames", reason, "make the run anew")
    return told, small


def _stamped(frames: Iterator[Frame], stamps: array[float]) -> Iterator[Frame]:
    """The ``frames``, whose times are noted in ``stamps``."""
    for frame in frames:
        stamps.append(frame.time)
        yield frame


def _glances(frames: Iterator[Frame]) -> np.ndarray:
    """Small pictures of ``frames``, (N, h, w, 3) uint8."""
    small = bytearray()
    for frame in frames:
        small += frame.small().tobytes()
    return np.frombuffer(small, np.uint8).reshape(-1, SMALL[1], SMALL[0], 3)


def within(times: np.ndarray, span: tuple[float, float]) -> np.ndarray:
    """Which of the frames at ``times`` (N,) [s] a span [s] names, (M,); a time may miss its ends by :data:`_TICK`."""
    return np.flatnonzero((times >= span[0] - _TICK) & (times <= span[1] + _TICK))


def files_of(path: Path, fps: float | None) -> list[Path]:
    """The images of a folder, none of a video.

    Raises:
        InputError: a folder holds none.
        UsageError: ``fps`` is given for a video.
    """
    if path.is_dir():
        return image_files(path)
    if fps is not None and path.exists():
        raise UsageError(path, "#fps", "expected a folder of images, a video has times of its own", "leave out #fps")
    return []


def _video_frames(path: Path, wanted: set[int]) -> Iterator[Frame]:
    # decoded a second time, so that only the frames kept take memory; what comes after them was looked at before
    first = islice(decode(path), max(wanted) + 1)
    return (frame for index, frame in enumerate(first) if index in wanted)


def images_of(files: list[Path]) -> Iterator[Frame]:
    """The frames of image files, all of one size.

    Raises:
        InputError: one is damaged or of another size.
    """
    first = None
    for file in files:
        frame = next(decode(file))
        first = first or frame
        if frame.size != first.size:
            raise InputError(file, "size", f"expected {first.size} as in {files[0].name}, got {frame.size}")
        yield frame


def _stack(path: Path, frames: Iterator[Frame], count: int, max_side: int) -> tuple[Tensor, tuple[str, ...]]:
    """All ``frames`` at one size, (N, 3, H, W) uint8, and their notes, each once."""
    first = next(frames)
    notes = dict.fromkeys(_notes(first))
    scale = min(1.0, max_side / max(first.size))
    size = (max(1, round(first.size[0] * scale)), max(1, round(first.size[1] * scale)))
    need = 3 * count * size[0] * size[1]
    if need > BYTE_LIMIT:
        reason = f"{count} of {size[0]}x{size[1]} need {need} bytes, the limit is {BYTE_LIMIT}"
        raise InputError(path, "frames", reason, HINT)
    require_free(need, path, f"{count} frames of {size[0]}x{size[1]}", HINT)
    image = torch.empty((count, 3, size[1], size[0]), dtype=torch.uint8)
    image[0] = torch.from_numpy(first.rgb(size)).permute(2, 0, 1)
    for index, frame in enumerate(frames, start=1):
        image[index] = torch.from_numpy(frame.rgb(size)).permute(2, 0, 1)
        notes |= dict.fromkeys(_notes(frame, TRANSPARENT in notes))
    return image, tuple(notes)


def _notes(frame: Frame, known: bool = False) -> tuple[str, ...]:
    """What a reader should know of a frame; whether it is transparent is looked at where that is not ``known``."""
    return (*frame.notes, TRANSPARENT) if not known and is_transparent(frame.raw) else frame.notes
