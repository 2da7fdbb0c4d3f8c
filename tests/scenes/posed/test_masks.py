"""Pixels that a set says not to count: `mask_path` of nerfstudio."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from cltransfer.errors import InputError, ResourceError
from cltransfer.fit._views import views_of
from cltransfer.scenes.posed import read_posed

SIZE = (40, 30)


def write_set(root: Path, masks: list[Any], **lens: Any) -> Path:
    """A set of grey images from around, one for each of ``masks``."""
    frames = []
    for index, mask in enumerate(masks):
        cv2.imwrite(str(root / f"{index}.png"), np.full((SIZE[1], SIZE[0], 3), 99, np.uint8))
        turn, pose = 2 * np.pi * index / len(masks), np.eye(4)
        pose[:3, :3] = [[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]]
        pose[:3, 3] = 3 * pose[:3, 2]
        frame = {"file_path": f"{index}.png", "transform_matrix": pose.tolist()}
        frames.append(frame if mask is None else {**frame, "mask_path": mask})
    data = {"w": SIZE[0], "h": SIZE[1], "fl_x": 50.0, **lens, "frames": frames}
    (root / "transforms.json").write_text(json.dumps(data))
    return root


def write_mask(path: Path, white: int = 255, size: tuple[int, int] = SIZE) -> None:
    """Black in the left quarter."""
    pixels = np.full((size[1], size[0]), white, np.uint8)
    pixels[:, : size[0] // 4] = 0
    cv2.imwrite(str(path), pixels)


@pytest.mark.parametrize("white", [255, 1])
@pytest.mark.parametrize("size", [SIZE, (80, 60), (20, 15)])
def test_black_of_a_mask_does_not_count(tmp_path: Path, white: int, size: tuple[int, int]) -> None:
    write_mask(tmp_path / "m.png", white, size)
    counted = views_of(read_posed(write_set(tmp_path, ["m.png", None, "m.png", ""])), 40).counted
    assert counted is not None
    assert torch.equal(counted[0], (torch.arange(40) >= 10).expand(30, 40))
    assert torch.equal(counted[2], counted[0])
    assert counted[1].all()
    assert counted[3].all()


def test_a_pixel_of_which_a_part_is_black_does_not_count(tmp_path: Path) -> None:
    write_mask(tmp_path / "m.png")
    counted = read_posed(write_set(tmp_path, ["m.png"] * 3)).counted([1], 8)  # five to one: the tenth is in the third
    assert counted is not None
    assert counted.shape == (1, 6, 8)
    assert counted[0, 0].tolist() == [False] * 2 + [True] * 6
    counted = read_posed(tmp_path).counted([1], 10)  # four to one
    assert counted is not None
    assert counted[0, 0].tolist() == [False] * 3 + [True] * 7


def test_a_mask_is_straightened_as_its_image_is(tmp_path: Path) -> None:
    write_mask(tmp_path / "m.png")
    pixels = np.full((SIZE[1], SIZE[0], 3), 200, np.uint8)
    pixels[:, :10] = 0
    root = write_set(tmp_path, ["m.png"] * 3, k1=-0.4)
    cv2.imwrite(str(root / "0.png"), pixels)
    posed = read_posed(root)
    counted = posed.counted([0], 40)
    assert counted is not None
    assert torch.equal(counted[0], posed.images([0], 40)[1][0, 0] == 200)
    assert not torch.equal(counted[0], (torch.arange(40) >= 10).expand(30, 40))


def test_a_set_without_masks_has_none(tmp_path: Path) -> None:
    posed = read_posed(write_set(tmp_path, [None] * 3))
    assert posed.counted([0, 1], 40) is None
    assert views_of(posed, 40).counted is None


@pytest.mark.parametrize(
    ("mask", "says"),
    [
        ("../m.png", r"../m.png: leads out of the folder"),
        (7, r"frames\[0\].mask_path: expected the name of an image, got 7"),
        ("gone.png", "gone.png: no such file"),
        ("wide.png", r"wide.png: size: expected the shape of 40x30, got \(60, 30\)"),
        ("black.png", "masks: 1 images are masked as a whole, e.g. 0.png"),
    ],
)
def test_a_mask_that_cannot_be_is_told(tmp_path: Path, mask: Any, says: str) -> None:
    write_mask(tmp_path / "wide.png", size=(60, 30))
    write_mask(tmp_path / "black.png", 0)
    write_set(tmp_path, [mask, None, None])
    with pytest.raises(InputError, match=says):
        views_of(read_posed(tmp_path), 40)


def test_a_camera_of_the_set_needs_no_mask(tmp_path: Path) -> None:
    posed = read_posed(write_set(tmp_path, ["gone.png", None, None]))
    assert len(posed.camera) == 3


def test_masks_that_do_not_fit_in_memory_are_refused_before_they_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    posed = read_posed(write_set(tmp_path, ["gone.png", None, None]))
    monkeypatch.setenv("CLTRANSFER_MEMORY", "1")
    with pytest.raises(ResourceError, match=r"transforms.json: memory: 3 masks of 40x30 need .* take a smaller side"):
        posed.counted(range(3), 40)
    assert read_posed(write_set(tmp_path, [None] * 3)).counted(range(3), 40) is None
