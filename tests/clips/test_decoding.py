"""What an image file is, whatever its name says."""

from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from cltransfer.clips.clip import read_clip
from cltransfer.errors import InputError


def folder_of(folder: Path, suffix: str, kind: str) -> Path:
    """Two images of one kind under names of a suffix."""
    folder.mkdir()
    for i, seed in enumerate((3, 4)):
        pixels = np.random.default_rng(seed).integers(0, 255, (24, 32, 3), dtype=np.uint8)
        Image.fromarray(pixels).save(folder / f"{i}.{suffix}", format=kind)
    return folder


@pytest.mark.parametrize(("kind", "right", "wrong"), [("JPEG", "jpg", "png"), ("PNG", "png", "jpeg")])
def test_an_image_is_what_its_first_bytes_say(tmp_path: Path, kind: str, right: str, wrong: str) -> None:
    named = read_clip(folder_of(tmp_path / "named", right, kind))
    misnamed = read_clip(folder_of(tmp_path / "misnamed", wrong, kind))
    assert torch.equal(misnamed.image, named.image)
    assert misnamed.source_size == (32, 24)


def test_a_jpeg_by_a_name_of_a_png_is_refused_where_it_is_cut_short_or_huge(tmp_path: Path) -> None:
    file = folder_of(tmp_path / "clip", "png", "JPEG") / "1.png"
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"1\.png: video: cannot be decoded: the file is cut short"):
        read_clip(file.parent)
    at = whole.index(b"\xff\xc0") + 5
    file.write_bytes(whole[:at] + b"\xff\xdc\xff\xdc" + whole[at + 4 :])
    with pytest.raises(InputError, match=r"1\.png: size: expected at most 64000000 pixels a frame, got 65500x65500"):
        read_clip(file.parent)


def test_what_is_neither_png_nor_jpeg_is_told_so(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        read_clip(folder_of(tmp_path / "clip", "png", "WEBP"))
    assert str(caught.value).endswith("0.png: image: is no PNG or JPEG, whatever its name (convert it)")


@pytest.mark.parametrize("name", ["0.png", "0.jpg", "0.mp4"])
def test_an_empty_file_is_told_so(tmp_path: Path, name: str) -> None:
    (tmp_path / name).touch()
    said = f"{name}: size: expected a clip or an image, the file is empty (copy or write it anew)"
    with pytest.raises(InputError) as caught:
        read_clip(tmp_path / name)
    assert str(caught.value).endswith(said)
