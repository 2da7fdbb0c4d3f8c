"""Frames of one video or image file, strictly: what its decoder finds damaged is an error, never a shorter clip."""

from __future__ import annotations

import contextlib
import io
import os
import shlex
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import av
from av.container import InputContainer
from av.stream import Disposition
from av.video.reformatter import VideoReformatter
from av.video.stream import VideoStream

from ..computer.threads import thread_count
from ..errors import InputError
from ..registry.declared import SCENE_SUFFIXES
from .frame import Frame
from .frame_notes import notes_on
from .image_header import exif_orientation, states_aspect, stored_size
from .jpeg_end import jpeg_ends
from .png_chunks import PNG, drawn_chunks
from .streams import STREAM_LIMIT, stamped_by_coding, streams_to_open

PIXEL_LIMIT = 4096 * 2160  # of a video's frame: what cinemas and many cameras call 4K
STILL_LIMIT = 64_000_000  # of an image file: 9504x6336; while one is read 0.3 GB, with alpha up to 1.2 GB
WIDENED = 4  # times as many that a video's frame is shown with at most: lenses of films squeeze by two
SCAN_LIMIT = 200_000  # frames of a file that are looked at, over two hours at 24 fps
IMAGE_BYTE_LIMIT = 2**28
CODED = 64  # rows and columns that a coded frame may have beyond those that are shown
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg")
VIDEOS = (".mp4", ".m4v", ".mov", ".3gp", ".mkv", ".webm", ".avi", ".ts", ".mts", ".m2ts")

_JPEG, _GIF = b"\xff\xd8", b"GIF8"
_DEMUXERS = {PNG: "png_pipe", _JPEG: "jpeg_pipe"}  # by the first bytes: browsers save one by the other's name
_MIRRORED = (2, 4, 5, 7)
_TURNS = {2: 2, 3: 2, 5: -1, 6: -1, 7: 1, 8: 1}  # quarter turns to the left, a mirrored one's rows reversed before
_BY_FRAME = ("mjpeg", "png")  # pictures of their own: a decoder that is told to says which of them is damaged

# Playlists and scripts that open other files are no clips, whatever their name ends in.
_OPTIONS = {
    "protocol_whitelist": "file",
    "format_whitelist": "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts,png_pipe,jpeg_pipe",
    "err_detect": "explode",
}
_PROBED = ",".join(sorted(name for name in av.codecs_available if "png" not in name))
"""Codecs of which frames are decoded to open a video; those of PNGs have all their chunks yet."""


def decode(path: Path, exif: bool = True) -> Iterator[Frame]:
    """Frames of ``path`` in order of presentation; without ``exif`` an image is upright as it is stored.

    Raises:
        InputError: the file is missing, is of no allowed kind, has no video, is damaged, changes size,
            exceeds a limit, has times that do not increase, or holds other than what its header says.
    """
    with _opened(path) as (container, stream):
        count, end, before, stamps, converter = 0, 0.0, None, list[int](), VideoReformatter()
        by_coding = stamped_by_coding(container, stream)
        for packet in container.demux():
            if packet.pts is not None:
                end = max(end, float((packet.pts + (packet.duration or 0)) * packet.time_base))
            if packet.stream.index != stream.index:
                continue
            stamps += [packet.pts] if by_coding and packet.pts is not None else []
            for raw in stream.decode(_drawn_packet(packet, stream)):
                raw.pts = stamps.pop(0) if stamps else raw.pts
                frame = _checked(path, count, raw, stream, exif, converter)
                if before is not None and (frame.size != before.size or frame.time <= before.time):
                    what = "size" if frame.size != before.size else "time"
                    now, then = getattr(frame, what), getattr(before, what)
                    raise InputError(path, f"frame {count}", f"{what} went from {then} to {now}", "re-encode it")
                count, before = count + 1, frame
                yield frame
        _check_complete(path, container, stream, count, end)


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[tuple[InputContainer, VideoStream]]:
    if not path.is_file():
        raise InputError(path, "", "no such file" if not path.exists() else "expected a file")
    if path.stat().st_size == 0:
        raise InputError(path, "size", "expected a clip or an image, the file is empty", "copy or write it anew")
    # "10:30.mp4" would name a protocol, 10
    demuxer, source = _image_source(path) if _is_image(path) else (None, str(path.absolute()))
    try:
        limited = {**_OPTIONS, "max_pixels": str(_pixel_limit(path))}  # of what is decoded to open it
        if demuxer is None:
            limited |= {"codec_whitelist": _PROBED, "max_streams": str(streams_to_open(path, _OPTIONS))}
        # titles may be of any code page
        with av.open(source, "r", format=demuxer, options=limited, metadata_errors="replace") as container:
            yield container, _video_stream(path, container)
    except av.FFmpegError as error:
        few = f"are there at most {STREAM_LIMIT} streams in it?" if isinstance(error, MemoryError) else ""
        raise InputError(path, "video", f"cannot be decoded: {error.strerror}", few or _expected(path)) from None


def _expected(path: Path) -> str:
    if not os.access(path, os.R_OK):
        return "it may not be read"
    if path.suffix.lower() == ".safetensors":
        told = "features that were read before are for `transfer`, `describe` and `inspect`"
        return f"{told}, a grid by a path through it: {shlex.quote(f'{path.name}@trajectory.json')}"
    if path.suffix.lower() in SCENE_SUFFIXES:
        return f"a scene is a reference by a path through it: {shlex.quote(f'{path.name}@trajectory.json')}"
    with path.open("rb") as stream:
        if stream.read(len(_GIF)) == _GIF:
            return "GIF is not read: convert it to mp4 or PNGs"
    kinds = "mp4, mov, mkv, webm, avi, ts, PNG or JPEG"
    if path.suffix.lower() in (*VIDEOS, *IMAGE_SUFFIXES):
        return f"if it is {kinds}, it is damaged or cut short: copy or download it anew"
    return f"expected {kinds}"


def _is_image(path: Path) -> bool:
    return path.suffix.lower() in IMAGE_SUFFIXES


def _image_source(path: Path) -> tuple[str, str | io.BytesIO]:
    """Demuxer and what it is given of an image file that is not too large and has an end."""
    if path.stat().st_size > IMAGE_BYTE_LIMIT:
        raise InputError(path, "size", f"expected at most {IMAGE_BYTE_LIMIT} bytes, got {path.stat().st_size}")
    data = path.read_bytes()
    kind = next((start for start in _DEMUXERS if data.startswith(start)), None)
    if kind is None:
        raise InputError(path, "image", "is no PNG or JPEG, whatever its name", "convert it")
    # the decoder fills up a JPEG that ends early without a word
    if kind == _JPEG and not jpeg_ends(data):
        raise InputError(path, "video", "cannot be decoded: the file is cut short")
    drawn = drawn_chunks(data) if kind == PNG else data
    _check_size(path, "size", stored_size(drawn) or (0, 0))  # of a larger one the decoder tells nothing
    return _DEMUXERS[kind], io.BytesIO(drawn) if kind == PNG else str(path.absolute())


def _drawn_packet(packet: av.Packet, stream: VideoStream) -> av.Packet:
    """A packet of a video; one of PNGs as :func:`.drawn_chunks` has it."""
    if stream.codec_context.name != "png" or packet.size == 0:
        return packet
    data = drawn_chunks(bytes(packet))
    drawn = av.Packet(len(data))  # of its own memory: a decoder's threads would wait for Python to give back its
    drawn.update(data)
    drawn.pts, drawn.dts, drawn.time_base = packet.pts, packet.dts, packet.time_base
    return drawn


def _video_stream(path: Path, container: InputContainer) -> VideoStream:
    streams = [s for s in container.streams.video if not s.disposition & Disposition.attached_pic]
    if not streams:
        raise InputError(path, "video", "no video stream")
    stream = streams[0]
    if stream.codec_context is None:
        raise InputError(path, "video", "is of a codec that cannot be decoded", "re-encode it")
    _check_size(path, "size", (stream.codec_context.width, stream.codec_context.height))
    if stream.frames > SCAN_LIMIT:
        raise InputError(path, "frames", f"expected at most {SCAN_LIMIT}, the header says {stream.frames}")
    if stream.codec_context.name == "apng":
        raise InputError(path, "video", "is of APNG", "re-encode it")
    strict = {"err_detect": "explode"} if stream.codec_context.name in _BY_FRAME else {}
    stream.codec_context.options = {"max_pixels": str(_most_decoded(path, stream)), **strict}
    stream.thread_type = "AUTO"
    stream.codec_context.thread_count = thread_count()
    return stream


def _most_decoded(path: Path, stream: VideoStream) -> int:
    """Pixels of a frame as it is coded, in whole blocks, at most: one may be larger than the header says."""
    sides = stream.codec_context.width, stream.codec_context.height
    return max(_pixel_limit(path), (sides[0] + CODED) * (sides[1] + CODED))


def _pixel_limit(path: Path) -> int:
    return STILL_LIMIT if _is_image(path) else PIXEL_LIMIT


def _check_size(path: Path, field: str, size: tuple[int, int], times: int = 1) -> None:
    most = times * _pixel_limit(path)
    if size[0] * size[1] > most:
        limit = f"expected at most {most} pixels a frame, got {size[0]}x{size[1]}"
        raise InputError(path, field, limit, "make it smaller")


def _checked(
    path: Path, index: int, raw: av.VideoFrame, stream: VideoStream, exif: bool, converter: VideoReformatter
) -> Frame:
    field = f"frame {index}"
    if index >= SCAN_LIMIT:
        raise InputError(path, "frames", f"expected at most {SCAN_LIMIT}, got more", "cut the clip")
    if raw.is_corrupt:
        raise InputError(path, field, "is damaged")
    if raw.time is None:
        raise InputError(path, field, "has no presentation time", "re-encode it")
    turns, mirrored = _upright(path, field, raw, exif)
    size = (max(1, round(raw.width * _aspect(path, stream))), raw.height)
    upright = size if turns % 2 == 0 else size[::-1]
    _check_size(path, field, (raw.width, raw.height))
    _check_size(path, field, upright, 1 if _is_image(path) else WIDENED)
    return Frame(raw, upright, raw.time, turns, mirrored, converter, tuple(notes_on(raw, stream)))


def _aspect(path: Path, stream: VideoStream) -> float:
    """Width of a pixel over its height."""
    aspect = float(stream.sample_aspect_ratio or 1)
    print_only = aspect != 1 and _is_image(path) and not states_aspect(path)
    return 1.0 if print_only else aspect


def _upright(path: Path, field: str, raw: av.VideoFrame, exif: bool) -> tuple[int, bool]:
    """Quarter turns to the left that the file asks for, and whether the rows are reversed before."""
    if _is_image(path):
        # the decoder reads nothing of an EXIF that is damaged anywhere
        orientation = exif_orientation(path) if exif else 1
        return _TURNS.get(orientation, 0), orientation in _MIRRORED
    if raw.rotation % 90:
        raise InputError(path, field, f"expected a rotation tag of quarter turns, got {raw.rotation} degrees")
    return raw.rotation // 90, _mirrored(raw)


def _mirrored(raw: av.VideoFrame) -> bool:
    """Whether a video asks for ``raw`` to be shown mirrored, of which its rotation says nothing."""
    try:
        matrix: Any = raw.side_data.get("DISPLAYMATRIX")
    except ValueError:  # there is a kind that PyAV does not know, as on frames of two views, which nothing mirrors
        return False
    if matrix is None:
        return False
    a, b, _, c, d, *_ = struct.unpack("=9i", bytes(matrix))
    return bool(a * d < b * c)


def _check_complete(path: Path, container: InputContainer, stream: VideoStream, count: int, end: float) -> None:
    """Compare ``count`` frames that end at ``end`` [s] with the header; Matroska promises a duration only."""
    hint = "the file is damaged or cut short; re-encode it"
    if count == 0:
        raise InputError(path, "frames", "expected at least 1, got 0")
    promised = stream.frames
    if "mp4" in container.format.name:  # the index knows what the edit list cuts off, the header does not
        promised = sum(not entry.is_discard for entry in stream.index_entries)
    elif "avi" in container.format.name:  # whose header counts frames that were dropped too
        promised = len(stream.index_entries) or promised
    if promised and count != promised:
        raise InputError(path, "frames", f"the header says {promised}, decoded {count}", hint)
    if "matroska" in container.format.name and container.duration:
        duration = container.duration / av.time_base
        slack = 0.1 + (float(1 / stream.average_rate) if stream.average_rate else 0.0)
        if end < duration - slack:
            raise InputError(path, "duration", f"the header says {duration:.2f} s, decoded {end:.2f} s", hint)
