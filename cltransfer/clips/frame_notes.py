"""What a reader should know of a video's frames: what their decoder tells, and what it leaves out."""

from __future__ import annotations

from collections.abc import Iterator

import av
from av.video.stream import VideoStream

from .alpha import TRANSPARENT

HDR = {16: "PQ", 18: "HLG"}  # transfer functions, as FFmpeg counts them


def notes_on(raw: av.VideoFrame, stream: VideoStream) -> Iterator[str]:
    """Notes on how a frame comes out, as it is decoded from ``stream``."""
    if raw.interlaced_frame and stream.codec_context.name != "png":  # whose rows are of one moment in any order
        yield "interlaced: two moments in each frame (deinterlace it first, as by ffmpeg -vf bwdif)"
    if (transfer := HDR.get(stream.codec_context.color_trc)) is not None:
        yield f"HDR ({transfer}): read as if it were SDR, washed out (convert it first)"
    if stream.metadata.get("alpha_mode") == "1":  # of WebM, whose decoder drops what tells how transparent a pixel is
        yield TRANSPARENT
