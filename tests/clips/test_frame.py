"""One frame's pixels: converted as by a converter of its own, whatever was asked of the frames before it."""

from pathlib import Path

import numpy as np
import pytest
import torch
from av.video.reformatter import Colorspace, VideoReformatter

from cltransfer.clips.clip import write_video
from cltransfer.clips.decoding import decode
from cltransfer.clips.frame import SMALL


def clip_of(path: Path, height: int) -> Path:
    """Four frames that differ, by BT.709 where the file is an mp4."""
    image = torch.from_numpy(np.random.default_rng(0).integers(0, 256, (4, 3, height, 48)).astype(np.uint8))
    write_video(path, image, torch.arange(4) / 24.0, lossless=path.suffix == ".mkv")
    return path


@pytest.mark.parametrize(("name", "height"), [("clip.mp4", 64), ("clip.mp4", 736), ("clip.mkv", 64)])
def test_pixels_do_not_depend_on_what_was_asked_of_other_frames(tmp_path: Path, name: str, height: int) -> None:
    path, seen = clip_of(tmp_path / name, height), set[int]()
    for number, frame in enumerate(decode(path)):
        seen.add(id(frame.converter))
        for _ in range(2):
            alone = VideoReformatter().reformat(frame.raw, *SMALL, format="rgb24", interpolation="AREA").to_ndarray()
            assert np.array_equal(frame.small(), alone)
            assert np.array_equal(frame.rgb(frame.size), frame.raw.to_ndarray(format="rgb24"))
            if number % 2:  # the others are asked in another order
                frame.converter.reformat(frame.raw, 7, 5, format="gray", dst_colorspace=Colorspace.ITU601)
    assert len(seen) == 1, "to set a converter up takes as long as to convert many frames"
