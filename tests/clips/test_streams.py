"""How many streams a file may have: films have many of sound, and few videos."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from cltransfer.clips.clip import read_clip
from cltransfer.clips.streams import STREAM_LIMIT, VIDEO_LIMIT, streams_to_open
from cltransfer.errors import InputError


def film(path: Path, videos: int, sounds: int = 0) -> Path:
    """Two frames of each video, a millisecond of each sound."""
    picture = np.random.default_rng(0).integers(0, 255, (16, 16, 3), dtype=np.uint8)
    with av.open(str(path), "w") as container:
        seen = [container.add_stream("mpeg4", rate=24) for _ in range(videos)]
        heard = [container.add_stream("mp2", rate=48000) for _ in range(sounds)]
        for stream in seen:
            stream.width, stream.height, stream.pix_fmt = 16, 16, "yuv420p"
        for i in range(2):
            for stream in seen:
                frame = av.VideoFrame.from_ndarray(picture)
                frame.pts = i
                container.mux(stream.encode(frame))
        for sound in heard:
            packet = av.Packet(b"\xff\xfd\x14\xc4" + bytes(188))  # 64 kbit/s, silent
            packet.stream, packet.pts, packet.dts, packet.time_base = sound, 0, 0, Fraction(1, 48000)
            container.mux(packet)
    return path


@pytest.mark.parametrize("kind", ["mkv", "mov", "ts"])
def test_a_film_of_many_languages_is_read(tmp_path: Path, kind: str) -> None:
    assert len(read_clip(film(tmp_path / f"film.{kind}", 1, 40))) == 2


@pytest.mark.parametrize("kind", ["mkv", "mov", "ts"])
def test_a_file_of_very_many_videos_is_not_opened(tmp_path: Path, kind: str) -> None:
    """A few bytes a stream took 40 MB each, which no limit counts."""
    assert len(read_clip(film(tmp_path / f"few.{kind}", VIDEO_LIMIT))) == 2
    many = film(tmp_path / f"many.{kind}", VIDEO_LIMIT + 1)
    with pytest.raises(InputError, match=r"streams: expected at most 32 videos, got 33 \(keep the video alone"):
        read_clip(many)


@pytest.mark.parametrize("kind", ["mkv", "mov"])
def test_a_file_of_very_many_streams_is_not_opened(tmp_path: Path, kind: str) -> None:
    assert len(read_clip(film(tmp_path / f"few.{kind}", 1, STREAM_LIMIT - 1))) == 2
    for count in (STREAM_LIMIT, STREAM_LIMIT + 1):
        many = film(tmp_path / f"{count}.{kind}", 1, count)
        with pytest.raises(InputError, match="at most 256"):
            read_clip(many)


@pytest.mark.parametrize(("videos", "sounds"), [(1, 0), (2, 40), (VIDEO_LIMIT, 1)])
def test_videos_that_come_late_are_no_more_than_may_be_opened(tmp_path: Path, videos: int, sounds: int) -> None:
    assert streams_to_open(film(tmp_path / "film.mkv", videos, sounds), {}) == sounds + VIDEO_LIMIT
