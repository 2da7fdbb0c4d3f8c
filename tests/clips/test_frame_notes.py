"""What a decoder drops of a frame is told."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
import pytest

from cltransfer.clips.alpha import TRANSPARENT
from cltransfer.clips.open_clip import open_clip
from cltransfer.clips.source import ClipSource


@pytest.mark.parametrize(
    ("codec", "kind", "notes"),
    [
        ("libvpx-vp9", "yuva420p", (TRANSPARENT,)),
        ("libvpx", "yuva420p", (TRANSPARENT,)),
        ("libvpx-vp9", "yuv420p", ()),
    ],
)
def test_a_webm_of_which_the_decoder_drops_the_alpha_is_told_once_to_be_transparent(
    codec: str, kind: str, notes: tuple[str, ...], tmp_path: Path
) -> None:
    with av.open(str(tmp_path / "a.webm"), "w") as container:
        stream = container.add_stream(codec, rate=8, options={"auto-alt-ref": "0"})  # which alpha asks of VP8
        stream.width, stream.height, stream.pix_fmt = 64, 48, kind
        for _ in range(3):
            frame = av.VideoFrame.from_ndarray(np.full((48, 64, 4), 90, np.uint8), format="rgba")
            container.mux(stream.encode(frame.reformat(format=kind)))
        container.mux(stream.encode())
    with av.open(str(tmp_path / "a.webm")) as container:
        assert next(container.decode(video=0)).format.name == "yuv420p"
    assert open_clip(ClipSource(tmp_path / "a.webm"))[1] == notes
