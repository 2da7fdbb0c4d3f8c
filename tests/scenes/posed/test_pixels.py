"""Images of a posed set are the pixels that its cameras were found for."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cltransfer.scenes.posed import read_posed

STORED = np.zeros((30, 40, 3), np.uint8)
STORED[:15] = 255  # the upper half is white
EASYMOCAP = '%YAML:1.0\n---\nnames:\n   - "a"\n'
MATRIX = "{}: !!opencv-matrix\n   rows: {}\n   cols: {}\n   dt: d\n   data: [ {} ]\n"


def write_photo(path: Path, orientation: int) -> None:
    path.parent.mkdir(parents=True)
    exif = Image.Exif()
    exif[0x0112] = orientation
    Image.fromarray(STORED).save(path, exif=exif, quality=95)


@pytest.mark.parametrize("orientation", [3, 6])
def test_photos_of_colmap_are_as_they_are_stored(tmp_path, orientation):
    write_photo(tmp_path / "images" / "a.jpg", orientation)
    (tmp_path / "cameras.txt").write_text("1 PINHOLE 40 30 40 40 20 15\n")
    (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 0 1 a.jpg\n\n")
    _, image = read_posed(tmp_path).images([0], 40)
    np.testing.assert_allclose(image[0].permute(1, 2, 0), STORED, atol=20)


def test_the_size_of_a_photo_that_the_set_does_not_say_is_as_stored(tmp_path):
    write_photo(tmp_path / "images" / "a.jpg", 6)
    frame = {"file_path": "images/a.jpg", "transform_matrix": np.eye(4).tolist()}
    (tmp_path / "transforms.json").write_text(json.dumps({"camera_angle_x": 1.0, "frames": [frame]}))
    posed = read_posed(tmp_path)
    assert posed.camera.size == (40, 30)
    assert posed.images([0], 40)[1][0, 0, [2, 27], 20].tolist() == [255, 0]


def test_photos_of_easymocap_are_turned_as_opencv_turns_them(tmp_path):
    write_photo(tmp_path / "images" / "a.jpg", 6)
    eye = "1, 0, 0, 0, 1, 0, 0, 0, 1"
    inside = MATRIX.format("K_a", 3, 3, "40, 0, 14.5, 0, 40, 19.5, 0, 0, 1")
    (tmp_path / "intri.yml").write_text(EASYMOCAP + inside)
    outside = MATRIX.format("Rot_a", 3, 3, eye) + MATRIX.format("T_a", 3, 1, "0, 0, 0")
    (tmp_path / "extri.yml").write_text("%YAML:1.0\n---\n" + outside)
    posed = read_posed(tmp_path)
    assert posed.camera.size == (30, 40)
    assert posed.images([0], 40)[1][0, 0, 20, [2, 27]].tolist() == [0, 255]


@pytest.mark.parametrize("colours", ["RGBA", "LA", "P"])
@pytest.mark.parametrize("side", [40, 20])
def test_what_is_transparent_is_black(tmp_path, colours, side):
    pixels = np.full((30, 40, 4), (255, 255, 255, 0), np.uint8)
    pixels[:, 20:, 3] = 255
    pixels[:, 30:, 3] = 128
    picture = Image.fromarray(pixels)
    if colours == "P":
        picture = picture.quantize(3)
    picture.convert(colours).save(tmp_path / "a.png")
    frame = {"file_path": "a", "transform_matrix": np.eye(4).tolist()}
    (tmp_path / "transforms.json").write_text(json.dumps({"camera_angle_x": 1.0, "frames": [frame]}))
    _, image = read_posed(tmp_path).images([0], side)
    expected = [0, 255, 128]
    assert image[0, 0, 5, [side // 4, side * 5 // 8, side * 7 // 8]].tolist() == expected
