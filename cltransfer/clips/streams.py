"""Streams of a video file: how many may be opened, as frames of each are decoded to know what it is; their times."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import av
from av.container import InputContainer
from av.video.stream import VideoStream

from ..errors import InputError

VIDEO_LIMIT = 32  # of a file, covers among them: to open it takes 40 MB for each of UHD
STREAM_LIMIT = 256  # of a file, its sound, subtitles and fonts too, which take little
REORDERING = ("h264", "hevc")  # whose decoders take the stamps of packets for those of frames
HINT = "keep the video alone, as by ffmpeg -map 0:v:0 -c copy"


def streams_to_open(path: Path, options: Mapping[str, str]) -> int:
    """Most streams that ``path`` may be opened with, no more than :data:`VIDEO_LIMIT` videos even if some come late.

    They are counted without a decoder, in 1 to 2 ms.

    Args:
        path: the file.
        options: of the demuxer.

    Raises:
        InputError: it has more of them than it may have.
        av.FFmpegError: it is of no kind that the options allow, or damaged.
    """
    # at the most some kinds end the file, and others go on without the rest
    counting = {**options, "codec_whitelist": "none", "max_streams": str(STREAM_LIMIT + 1)}
    with av.open(str(path.absolute()), "r", options=counting, metadata_errors="replace") as container:
        count, videos = len(container.streams), len(container.streams.video)
    if count > STREAM_LIMIT:
        raise InputError(path, "streams", f"expected at most {STREAM_LIMIT}, got more", HINT)
    if videos > VIDEO_LIMIT:
        raise InputError(path, "streams", f"expected at most {VIDEO_LIMIT} videos, got {videos}", HINT)
    return count - videos + VIDEO_LIMIT


def stamped_by_coding(container: InputContainer, stream: VideoStream) -> bool:
    """Whether packets have times in the order in which frames are coded, and not in that in which they are shown.

    AVI keeps no other; MPEG-4's decoder makes the right ones of them by itself.
    """
    return "avi" in container.format.name and stream.codec_context.name in REORDERING
