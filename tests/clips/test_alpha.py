"""Transparent clips: read as if they were opaque, and told."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
import pytest
import torch
from PIL import Image

from cltransfer.clips.alpha import TRANSPARENT, over_black
from cltransfer.clips.open_clip import open_clip
from cltransfer.clips.pairs import open_pairs
from cltransfer.clips.source import ClipSource


def images(folder: Path, alpha: list[int], mode: str = "RGBA") -> ClipSource:
    """A folder of grey images, of each of which one pixel has this ``alpha``."""
    folder.mkdir()
    for i, value in enumerate(alpha):
        rgba = np.full((16, 24, 4), 255, np.uint8)
        rgba[..., :3] = 90
        rgba[3, 4, 3] = value
        Image.fromarray(rgba).convert(mode).save(folder / f"{i}.png")
    return ClipSource(folder, fps=8)


@pytest.mark.parametrize(
    ("alpha", "mode", "notes"),
    [
        ([255, 255, 254], "RGBA", (TRANSPARENT,)),
        ([0, 0, 0], "LA", (TRANSPARENT,)),
        ([0, 255, 0], "P", (TRANSPARENT,)),
        ([255, 255, 255], "RGBA", ()),  # as many programs write what is opaque
        ([255, 255, 255], "P", ()),
        ([0, 0, 0], "RGB", ()),
    ],
)
def test_a_clip_that_is_transparent_is_told_once_and_read_in_the_colours_under_it(
    alpha: list[int], mode: str, notes: tuple[str, ...], tmp_path: Path
) -> None:
    clip, told = open_clip(images(tmp_path / "a", alpha, mode))
    assert told == notes
    assert (clip.image == 90).all()


def test_of_two_clips_each_is_told_by_itself(tmp_path: Path) -> None:
    one, other = images(tmp_path / "a", [255, 255]), images(tmp_path / "b", [255, 0])
    assert open_pairs(one, other, None)[1:] == ((), (TRANSPARENT,))


def test_a_video_may_be_transparent_too(tmp_path: Path) -> None:
    with av.open(str(tmp_path / "a.mkv"), "w") as container:
        stream = container.add_stream("ffv1", rate=8)
        stream.width, stream.height, stream.pix_fmt = 24, 16, "bgra"
        for _ in range(2):
            rgba = np.full((16, 24, 4), 90, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(rgba, format="rgba").reformat(format="bgra")))
        container.mux(stream.encode())
    clip, told = open_clip(ClipSource(tmp_path / "a.mkv"))
    assert told == (TRANSPARENT,)
    assert torch.equal(clip.image, torch.full((2, 3, 16, 24), 90, dtype=torch.uint8))


def test_over_black_a_colour_is_as_dark_as_it_is_transparent() -> None:
    rgba = np.array([[[200, 100, 0, 255], [200, 100, 0, 128], [200, 100, 0, 0]]], np.uint8)
    assert over_black(rgba).tolist() == [[[200, 100, 0], [100, 50, 0], [0, 0, 0]]]
