"""Clips: a video or a folder of images in, a video out, and frames of two clips paired by time."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import av
import numpy as np
import torch
from torch import Tensor

from .decoding import IMAGE_DEMUXERS, Frame, decode
from .errors import InputError, ResourceError
from .features import Features
from .files import atomic, read_json
from .threads import thread_count

FRAME_LIMIT = 2000  # frames kept in memory
BYTE_LIMIT = 4 * 2**30  # of all frames kept
FOLDER_RATE = 24.0  # frames a second where a folder of images does not say


@dataclass(frozen=True)
class Clip:
    """Frames and when they are shown.

    Args:
        image: RGB, (N, 3, H, W) uint8.
        times: (N,) float64 [s], increasing, the first frame of the file is at 0.
        path: where it was read from.
        source_size: (W, H) [px] of the file as shown: upright and with square pixels.
    """

    image: Tensor  # (N, 3, H, W)
    times: Tensor  # (N,) [s]
    path: Path
    source_size: tuple[int, int]

    def __len__(self) -> int:
        return len(self.times)

    @property
    def size(self) -> tuple[int, int]:
        """(W, H) [px] of ``image``."""
        return self.image.shape[3], self.image.shape[2]

    def features(self) -> Features:
        """The frames as features, RGB float32 in [0, 1]."""
        return Features(self.size, image=self.image.float() / 255)


def read_clip(path: str | Path, frames: int | None = None, max_side: int = 960) -> Clip:
    """Read a video file, or a folder of PNG or JPEG images in the natural order of their names.

    Args:
        path: the video or folder. A folder plays at 24 images a second, or as its ``times.json`` says (a list
            of seconds, one per image).
        frames: keep at most this many, evenly by index, first and last included; None keeps all.
        max_side: larger frames are averaged down to this longer side [px].

    Raises:
        InputError: the clip is missing, damaged, too large or not what its header says.
        ValueError: ``frames`` or ``max_side`` is not positive.
    """
    path = Path(path)
    if (frames is not None and frames < 1) or max_side < 1:
        raise ValueError(f"frames and max_side must be at least 1, got {frames} and {max_side}")
    files = _image_files(path) if path.is_dir() else []
    times = _folder_times(path, files) if files else np.array([frame.time for frame in decode(path)])
    kept = _evenly(len(times), frames)
    if len(kept) > FRAME_LIMIT:
        reason = f"expected at most {FRAME_LIMIT} to keep, got {len(kept)}"
        raise InputError(path, "frames", reason, "keep fewer of them, or cut the clip")
    chosen = _images([files[i] for i in kept]) if files else _video_frames(path, set(kept.tolist()))
    image, source_size = _stack(path, chosen, len(kept), max_side)
    return Clip(image, torch.from_numpy(times[kept] - times[0]), path, source_size)


def _evenly(count: int, wanted: int | None) -> np.ndarray:
    if wanted is None or wanted >= count:
        return np.arange(count)
    return np.linspace(0, count - 1, wanted).round().astype(int)


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


def natural_order(name: str) -> list[tuple[int, str]]:
    """Key by which names sort as people count.

    >>> sorted(["cam10", "cam9"], key=natural_order)
    ['cam9', 'cam10']
    """
    parts = re.split(r"(\d+)", name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]


def _image_files(folder: Path) -> list[Path]:
    files = [f for f in folder.iterdir() if f.suffix.lower() in IMAGE_DEMUXERS]
    files.sort(key=lambda file: natural_order(file.name))
    if not files:
        raise InputError(folder, "images", "expected PNG or JPEG files, found none")
    return files


def _folder_times(folder: Path, files: list[Path]) -> np.ndarray:
    if not (folder / "times.json").exists():
        _check_no_gap(files)
        return np.arange(len(files)) / FOLDER_RATE
    given = read_json(folder / "times.json")
    try:
        times = np.array(given, dtype=np.float64)
    except (TypeError, ValueError):
        times = np.empty(0)
    if times.shape != (len(files),) or not (np.isfinite(times).all() and (np.diff(times) > 0).all()):
        raise InputError(folder / "times.json", "", f"expected {len(files)} increasing seconds, one per image")
    return times


def _check_no_gap(files: list[Path]) -> None:
    found = [re.search(r"(\d+)\D*$", file.stem) for file in files]
    numbers = [int(match[1]) for match in found if match]
    if len(numbers) < len(files):
        return
    step = min((b - a for a, b in pairwise(numbers)), default=1)
    for (a, b), file in zip(pairwise(numbers), files[1:]):
        if b - a != step:
            reason = f"follows number {a}, expected {a + step}"
            raise InputError(file, "number", reason, "an image is missing; a times.json states other times")


def write_video(path: str | Path, image: Tensor, times: Tensor, lossless: bool = False) -> None:
    """Write frames with their own times; the file appears whole, with its frames counted, or not at all.

    Args:
        path: ``.mp4`` (H.264, yuv420p, crf 18, BT.709; an odd side is padded by one repeated row or column)
            or, where ``lossless``, ``.mkv`` (FFV1, RGB exact to the bit).
        image: RGB, (N, 3, H, W) uint8.
        times: (N,) [s], increasing; written from 0, rounded to 1/90000 s in mp4 and to 1 ms in mkv.
        lossless: which of the two.

    Raises:
        ValueError: a shape, type or suffix is wrong, or two times are equal once rounded.
        ResourceError: the file cannot be written or does not read back.
    """
    path = Path(path)
    if image.dtype != torch.uint8 or image.dim() != 4 or image.shape[1] != 3 or len(image) < 1:
        raise ValueError(f"image must be (N, 3, H, W) uint8, got {tuple(image.shape)} {image.dtype}")
    suffix, rate = (".mkv", 1000) if lossless else (".mp4", 90_000)
    if path.suffix.lower() != suffix:
        raise ValueError(f"path must end in {suffix}, got {path.name}")
    pts = ((times - times[0]) * rate).round().long()  # (N,) [1/rate s]
    if len(pts) != len(image) or bool((pts.diff() <= 0).any()):
        raise ValueError(f"expected {len(image)} times that increase by at least 1/{rate} s, got {times.tolist()}")
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
