"""Clips: a video or a folder of images in, a video out, and frames of two clips paired by time."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import torch
from torch import Tensor

from .decoding import Frame, decode
from .errors import InputError, ResourceError, UsageError
from .features import Features
from .files import atomic
from .image_folder import FOLDER_RATE, folder_times, image_files
from .threads import thread_count

FRAME_LIMIT = 2000  # frames kept in memory
BYTE_LIMIT = 4 * 2**30  # of all frames kept
_TICK = 1e-6  # [s] by which a time may miss the end of a span


@dataclass(frozen=True)
class Clip:
    """Frames and when they are shown.

    Args:
        image: RGB, (N, 3, H, W) uint8.
        times: (N,) float64 [s], increasing, the first frame is at 0.
        path: where it was read from.
        source_size: (W, H) [px] of the file as shown: upright and with square pixels.
        start: when the first of them is shown in the file [s].
    """

    image: Tensor  # (N, 3, H, W)
    times: Tensor  # (N,) [s]
    path: Path
    source_size: tuple[int, int]
    start: float = 0.0

    def __len__(self) -> int:
        return len(self.times)

    @property
    def size(self) -> tuple[int, int]:
        """(W, H) [px] of ``image``."""
        return self.image.shape[3], self.image.shape[2]

    def features(self) -> Features:
        """The frames as features, RGB float32 in [0, 1]."""
        return Features(self.size, image=self.image.float() / 255)


def read_clip(
    path: str | Path,
    frames: int | None = None,
    max_side: int = 960,
    span: tuple[float, float] = (0.0, math.inf),
    fps: float | None = None,
) -> Clip:
    """Read a video file, or a folder of PNG or JPEG images in the natural order of their names.

    Args:
        path: the video or folder. A folder plays as its ``times.json`` says (a list of seconds, one per image).
        frames: keep at most this many, evenly by time, first and last included; None keeps all.
        max_side: larger frames are averaged down to this longer side [px].
        span: from when to when to read, both included [s] after the first frame.
        fps: images a second of a folder without ``times.json``; None takes 24.

    Raises:
        InputError: the clip is missing, damaged, too large or not what its header says.
        UsageError: ``fps`` is given for a clip that has times of its own.
        ValueError: ``frames``, ``max_side`` or ``fps`` is not positive.
    """
    path = Path(path)
    if (frames is not None and frames < 1) or max_side < 1 or (fps is not None and fps <= 0):
        raise ValueError(f"frames, max_side and fps must be positive, got {frames}, {max_side} and {fps}")
    files = _files(path, fps)
    times = folder_times(path, files, fps) if files else np.array([frame.time for frame in decode(path)])
    times = times - times[0]
    inside = np.flatnonzero((times >= span[0] - _TICK) & (times <= span[1] + _TICK))
    if len(inside) == 0:
        raise InputError(path, "t", f"no frame between {span[0]:g} and {span[1]:g} s, it ends at {times[-1]:.3f} s")
    kept = inside[_evenly(times[inside], frames)]
    if len(kept) > FRAME_LIMIT:
        reason = f"expected at most {FRAME_LIMIT} to keep, got {len(kept)}"
        raise InputError(path, "frames", reason, "keep fewer of them, or cut the clip")
    chosen = _images([files[i] for i in kept]) if files else _video_frames(path, set(kept.tolist()))
    image, source_size = _stack(path, chosen, len(kept), max_side)
    start = float(times[kept[0]])
    return Clip(image, torch.from_numpy(times[kept] - start), path, source_size, start)


def timed_frames(path: Path, fps: float | None = None) -> Iterator[tuple[float, Frame]]:
    """Every frame of a video, or of an image folder that may need ``fps``, with its time after the first [s]."""
    files = _files(path, fps)
    if files:
        times = folder_times(path, files, fps)
        yield from zip((times - times[0]).tolist(), _images(files))
        return
    first = None
    for frame in decode(path):
        first = frame.time if first is None else first
        yield frame.time - first, frame


def _files(path: Path, fps: float | None) -> list[Path]:
    """The images of a folder, none of a video."""
    if path.is_dir():
        return image_files(path)
    if fps is not None and path.exists():
        raise UsageError(path, "#fps", "expected a folder of images, a video has times of its own", "leave out #fps")
    return []


def _evenly(times: np.ndarray, wanted: int | None) -> np.ndarray:
    """Indices of ``wanted`` frames that are nearest to evenly spaced times, each another one."""
    count = len(times)
    if wanted is None or wanted >= count:
        return np.arange(count)
    even = np.linspace(times[0], times[-1], wanted)
    after = np.searchsorted(times, even).clip(1, count - 1)
    nearest = np.where(even - times[after - 1] <= times[after] - even, after - 1, after)
    order = np.arange(wanted)
    distinct = np.maximum.accumulate(nearest - order) + order  # pushed on where two would be the same
    return np.minimum(distinct, count - wanted + order)


def _video_frames(path: Path, wanted: set[int]) -> Iterator[Frame]:
    # decoded a second time, so that only the frames kept take memory
    return (frame for index, frame in enumerate(decode(path)) if index in wanted)


def _images(files: list[Path]) -> Iterator[Frame]:
    first = None
    for file in files:
        frame = next(decode(file))
        first = first or frame
        if frame.size != first.size:
            raise InputError(file, "size", f"expected {first.size} as in {files[0].name}, got {frame.size}")
        yield frame


def _stack(path: Path, frames: Iterator[Frame], count: int, max_side: int) -> tuple[Tensor, tuple[int, int]]:
    """All ``frames`` at one size, (N, 3, H, W) uint8, and the size (W, H) they came in."""
    first = next(frames)
    scale = min(1.0, max_side / max(first.size))
    size = (max(1, round(first.size[0] * scale)), max(1, round(first.size[1] * scale)))
    need = 3 * count * size[0] * size[1]
    if need > BYTE_LIMIT:
        reason = f"{count} of {size[0]}x{size[1]} need {need} bytes, the limit is {BYTE_LIMIT}"
        raise InputError(path, "frames", reason, "keep fewer or smaller frames")
    image = torch.empty((count, 3, size[1], size[0]), dtype=torch.uint8)
    image[0] = torch.from_numpy(first.rgb(size)).permute(2, 0, 1)
    for index, frame in enumerate(frames, start=1):
        image[index] = torch.from_numpy(frame.rgb(size)).permute(2, 0, 1)
    return image, first.size


def write_video(path: str | Path, image: Tensor, times: Tensor, lossless: bool = False) -> None:
    """Write frames with their own times; the file appears whole, with its frames counted, or not at all.

    Args:
        path: ``.mp4`` (H.264, yuv420p, crf 18, BT.709; an odd side is padded by one repeated row or column)
            or, where ``lossless``, ``.mkv`` (FFV1, RGB exact to the bit).
        image: RGB, (N, 3, H, W) uint8.
        times: (N,) [s], increasing; written from 0, rounded to 1/90000 s in mp4 and to 1 ms in mkv, and where two
            would be one, the later ones that much later.
        lossless: which of the two.

    Raises:
        ValueError: a shape, type or suffix is wrong, or the times do not increase.
        ResourceError: the file cannot be written or does not read back.
    """
    path = Path(path)
    if image.dtype != torch.uint8 or image.dim() != 4 or image.shape[1] != 3 or len(image) < 1:
        raise ValueError(f"image must be (N, 3, H, W) uint8, got {tuple(image.shape)} {image.dtype}")
    suffix, rate = (".mkv", 1000) if lossless else (".mp4", 90_000)
    if path.suffix.lower() != suffix:
        raise ValueError(f"path must end in {suffix}, got {path.name}")
    if len(times) != len(image) or not bool((times.diff() > 0).all()):
        raise ValueError(f"expected {len(image)} times that increase, got {times.tolist()}")
    number = torch.arange(len(times))
    pts = (((times - times[0]) * rate).round().long() - number).cummax(0).values + number  # (N,) [1/rate s]
    try:
        with atomic(path) as temporary:
            _encode(temporary, image, pts, Fraction(1, rate))
            count = sum(1 for _ in decode(temporary))
            if count != len(image):
                raise ResourceError(path, "frames", f"{len(image)} were written, {count} read back")
    except (av.FFmpegError, OSError) as error:
        raise ResourceError(path, "", f"cannot be written: {error.strerror}") from None


def _encode(path: Path, image: Tensor, pts: Tensor, time_base: Fraction) -> None:
    lossless = path.suffix.lower() == ".mkv"
    interval = float(pts.diff().double().mean()) * time_base if len(pts) > 1 else 1 / FOLDER_RATE
    with av.open(str(path), "w") as container:
        stream = container.add_stream(
            "ffv1" if lossless else "libx264", rate=Fraction(1 / interval).limit_denominator(1001)
        )
        codec = stream.codec_context
        stream.height, stream.width = image.shape[2:] if lossless else (s + s % 2 for s in image.shape[2:])
        stream.pix_fmt = "bgr0" if lossless else "yuv420p"
        codec.time_base, codec.thread_count = time_base, thread_count()
        if not lossless:
            stream.options = {"crf": "18"}
            codec.colorspace = codec.color_primaries = codec.color_trc = 1  # BT.709
        for rgb, stamp in zip(image, pts.tolist()):
            frame = _video_frame(rgb, stream.pix_fmt)
            frame.pts, frame.time_base = stamp, time_base
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def _video_frame(rgb: Tensor, pix_fmt: str) -> av.VideoFrame:
    pixels = rgb.permute(1, 2, 0).contiguous().numpy()
    if pix_fmt == "bgr0":
        return av.VideoFrame.from_ndarray(pixels, format="rgb24").reformat(format="bgr0")
    pixels = np.pad(pixels, ((0, pixels.shape[0] % 2), (0, pixels.shape[1] % 2), (0, 0)), mode="edge")
    return av.VideoFrame.from_ndarray(pixels, format="rgb24").reformat(format="yuv420p", dst_colorspace="ITU709")


def pair_by_time(times: Tensor, other: Tensor) -> Tensor:
    """Index (M,) int64 of the nearest of ``times`` (N,) [s] for each of ``other`` (M,) [s]; both increase.

    Raises:
        InputError: the two spans of time do not meet.

    >>> pair_by_time(torch.tensor([0.0, 0.5, 1.0]), torch.tensor([0.1, 0.6, 1.4]))
    tensor([0, 1, 2])
    """
    if times[0] > other[-1] or other[0] > times[-1]:
        spans = " and ".join(f"{float(t[0]):.3f} to {float(t[-1]):.3f} s" for t in (times, other))
        raise InputError("", "times", f"the clips share no moment: {spans}")
    return (times[None, :] - other[:, None]).abs().argmin(dim=1)
