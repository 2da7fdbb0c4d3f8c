"""Images of a set that are there, and of a kind that is not read, are told to be that; their cameras are read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from cltransfer.errors import InputError
from cltransfer.fit._views import left_out, views_of
from cltransfer.scenes.posed import named_camera, read_posed


def write_set(root: Path, names: list[str], more: dict[str, Any] | None = None, **lens: Any) -> Path:
    """A transforms.json with black images from around, each of whose frames has ``more``."""
    frames = []
    for index, name in enumerate(names):
        Image.new("RGB", (8, 6)).save(root / name)
        turn, pose = 2 * np.pi * index / len(names), np.eye(4)
        pose[:3, :3] = [[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]]
        pose[:3, 3] = 3 * pose[:3, 2]
        frames.append({"file_path": name, "transform_matrix": pose.tolist(), **(more or {})})
    (root / "transforms.json").write_text(json.dumps({"fl_x": 8, **lens, "frames": frames}))
    return root


def told(file: str, kind: str) -> str:
    return rf"{file}: is {kind}, expected PNG or JPEG \(convert the images, and their names in the set\)"


@pytest.mark.parametrize("kind", [".webp", ".tif", ".TIFF"])
def test_an_image_of_a_kind_that_is_not_read_is_there_and_is_refused(tmp_path: Path, kind: str) -> None:
    path = write_set(tmp_path, ["0.png", f"1{kind}", "2.png", "3.png"], w=8, h=6)
    posed = read_posed(path)
    assert (posed.missing, left_out(posed), len(posed)) == ((), [], 4)
    with pytest.raises(InputError, match=told(f"1{kind}", kind.lower())):
        views_of(posed, 8)
    assert named_camera(f"{path}:1", "--init") is not None


def test_where_a_set_does_not_say_the_size_of_such_an_image_it_is_refused_at_once(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=told("0.webp", ".webp")):
        read_posed(write_set(tmp_path, ["0.webp"]))


def test_a_mask_of_a_kind_that_is_not_read_is_refused(tmp_path: Path) -> None:
    path = write_set(tmp_path, ["0.png", "1.png", "2.png"], {"mask_path": "m.webp"}, w=8, h=6)
    Image.new("L", (8, 6), 255).save(path / "m.webp")
    with pytest.raises(InputError, match=told("m.webp", ".webp")):
        views_of(read_posed(path), 8)


def test_an_image_that_is_read_goes_before_one_of_its_name_that_is_not(tmp_path: Path) -> None:
    path = write_set(tmp_path, ["0.webp"], w=8, h=6)
    Image.new("RGB", (8, 6), (9, 9, 9)).save(path / "0.webp.png")
    assert read_posed(path).images([0], 8)[1].unique().tolist() == [9]


def test_an_image_that_is_not_there_is_missing_whatever_its_kind(tmp_path: Path) -> None:
    path = write_set(tmp_path, ["0.webp", "1.png"], w=8, h=6)
    (path / "0.webp").unlink()
    assert read_posed(path).missing == ("0.webp",)
