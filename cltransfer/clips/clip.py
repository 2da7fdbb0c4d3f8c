"""Clips: a video or a folder of images in, a video out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import torch
from av.video.reformatter import Colorspace, VideoReformatter
from torch import Tensor

from ..along_clip import LONGEST
from ..computer.threads import thread_count
from ..errors import ResourceError
from ..features import Features
from ..storage.files import atomic
from .decoding import decode
from .image_folder import FOLDER_RATE
from .part import ClipPart, find_part
from .thinned import evenly

FINE = 1e4  # [s] that an mp4 lasts at most by 90 kHz: it holds 2^31 ticks, and B-frames take twice the span of all


@dataclass(frozen=True)
class Clip:
    """Frames and when they are shown.

    Args:
        image: RGB, (N, 3, H, W) uint8, upright and with square pixels.
        times: (N,) float64 [s], increasing, the first frame is at 0.
        path: where it was read from.
        start: when the first of them is shown in the file [s].
        notes: what a reader should know of how they come out, as of interlaced ones.
    """

    image: Tensor  # (N, 3, H, W)
    times: Tensor  # (N,) [s]
    path: Path
    start: float = 0.0
    notes: tuple[str, ...] = ()

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
        ResourceError: its frames do not fit in memory.
        UsageError: ``fps`` is given for a clip that has times of its own.
        ValueError: ``frames``, ``max_side`` or ``fps`` is not positive.
    """
    if (frames is not None and frames < 1) or max_side < 1 or (fps is not None and fps <= 0):
        raise ValueError(f"frames, max_side and fps must be positive, got {frames}, {max_side} and {fps}")
    part = find_part(Path(path), span, fps)
    return clip_of(part, evenly(part.times, frames), max_side)


def clip_of(part: ClipPart, kept: Tensor, max_side: int = 960) -> Clip:
    """Those frames of ``part`` that are ``kept``, (K,) int64 increasing; see :func:`read_clip`.

    Raises:
        InputError: they are damaged or too many.
        ResourceError: they do not fit in memory.
    """
    image, notes = part.images(kept.tolist(), max_side)
    times = part.times[kept]
    return Clip(image, times - times[0], part.path, float(times[0]), notes)


def write_video(path: str | Path, image: Tensor, times: Tensor, lossless: bool = False, comment: str = "") -> None:
    """Write frames with their own times; the file appears whole, with its frames counted, or not at all.

    Args:
        path: ``.mp4`` (H.264, yuv420p, crf 18, BT.709; an odd side is padded by one repeated row or column)
            or, where ``lossless``, ``.mkv`` (FFV1, RGB exact to the bit).
        image: RGB, (N, 3, H, W) uint8.
        times: (N,) [s], increasing; written from 0, rounded to 1/90000 s in mp4 and to 1 ms in mkv and in an mp4 that
            lasts longer than :data:`FINE`, and where two would be one, the later ones that much later.
        lossless: which of the two.
        comment: what the file says of itself; in an mp4 it stands within the last bytes.

    Raises:
        ValueError: a shape, type or suffix is wrong, or the times do not increase.
        ResourceError: the file cannot be written or does not read back, or an mp4 would last longer than
            :data:`~cltransfer.along_clip.LONGEST`.
    """
    path = Path(path)
    if image.dtype != torch.uint8 or image.dim() != 4 or image.shape[1] != 3 or len(image) < 1:
        raise ValueError(f"image must be (N, 3, H, W) uint8, got {tuple(image.shape)} {image.dtype}")
    suffix = ".mkv" if lossless else ".mp4"
    if path.suffix.lower() != suffix:
        raise ValueError(f"path must end in {suffix}, got {path.name}")
    if len(times) != len(image) or not bool((times.diff() > 0).all()):
        raise ValueError(f"expected {len(image)} times that increase, got {times.tolist()}")
    span = float(times[-1] - times[0])
    if not lossless and span > LONGEST:
        raise ResourceError(path, "times", f"an mp4 holds {LONGEST:g} s, got {span:g} s", "show a part: #t=START,END")
    rate = 1000 if lossless or span > FINE else 90_000
    number = torch.arange(len(times))
    pts = (((times - times[0]) * rate).round().long() - number).cummax(0).values + number  # (N,) [1/rate s]
    try:
        with atomic(path) as temporary:
            _encode(temporary, image, pts, Fraction(1, rate), comment)
            count = sum(1 for _ in decode(temporary))
            if count != len(image):
                raise ResourceError(path, "frames", f"{len(image)} were written, {count} read back")
    except (av.FFmpegError, OSError) as error:
        raise ResourceError(path, "", f"cannot be written: {error.strerror}") from None


def _encode(path: Path, image: Tensor, pts: Tensor, time_base: Fraction, comment: str) -> None:
    lossless = path.suffix.lower() == ".mkv"
    interval = float(pts.diff().double().mean()) * time_base if len(pts) > 1 else 1 / FOLDER_RATE
    options = {"fflags": "+bitexact"}  # no number of its own
    if not lossless:
        # of both clocks the former cuts the end off by other ticks, the latter makes more of few
        options["movie_timescale"] = options["video_track_timescale"] = str(time_base.denominator)
    with av.open(str(path.absolute()), "w", options=options) as container:
        if comment:
            container.metadata["comment"] = comment
        stream = container.add_stream(
            "ffv1" if lossless else "libx264", rate=Fraction(1 / interval).limit_denominator(1001)
        )
        codec = stream.codec_context
        stream.height, stream.width = image.shape[2:] if lossless else (s + s % 2 for s in image.shape[2:])
        stream.pix_fmt = "bgr0" if lossless else "yuv420p"
        codec.time_base, codec.thread_count = time_base, thread_count()
        if not lossless:
            stream.options = {"crf": "18", "x264-params": "mbtree=0"}  # with it bits differ from run to run
            codec.colorspace = codec.color_primaries = codec.color_trc = 1  # BT.709
        converter = VideoReformatter()
        for rgb, stamp in zip(image, pts.tolist()):
            frame = _video_frame(rgb, stream.pix_fmt, converter)
            frame.pts, frame.time_base = stamp, time_base
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def _video_frame(rgb: Tensor, pix_fmt: str, converter: VideoReformatter) -> av.VideoFrame:
    pixels = rgb.permute(1, 2, 0).contiguous().numpy()
    if pix_fmt == "bgr0":
        return converter.reformat(av.VideoFrame.from_ndarray(pixels, format="rgb24"), format="bgr0")
    pixels = np.pad(pixels, ((0, pixels.shape[0] % 2), (0, pixels.shape[1] % 2), (0, 0)), mode="edge")
    frame = av.VideoFrame.from_ndarray(pixels, format="rgb24")
    return converter.reformat(frame, format="yuv420p", dst_colorspace=Colorspace.ITU709)
