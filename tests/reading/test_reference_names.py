"""What the name of a reference says it is."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from cltransfer.clips.clip import read_clip
from cltransfer.clips.open_clip import ASSUMED
from cltransfer.config import load_config
from cltransfer.errors import InputError
from cltransfer.pipeline.components import Components
from cltransfer.reading.reference import Reading, read_reference


@pytest.mark.parametrize("scene", ["scene.ply", "scenes/scene.ply"])
@pytest.mark.parametrize("path", ["path.json", "paths/path.json"])
def test_a_scene_with_a_trajectory_may_lie_in_other_folders(scene: str, path: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        read_reference(f"{tmp_path / scene}@{tmp_path / path}", Components.build(load_config()), Reading())
    assert str(caught.value) == f"{tmp_path / path}: no such file"  # and not a clip of that long name


def test_a_folder_at_another_rate_is_read_anew_and_one_without_is_told(
    mean_flow: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path / "cache"))
    (tmp_path / "frames").mkdir()
    grey = np.random.default_rng(0).integers(0, 255, (36, 64, 3), np.uint8)
    for i in range(10):
        assert cv2.imwrite(str(tmp_path / "frames" / f"{i}.png"), np.roll(grey, i, 1))
    parts = Components.build(load_config(overrides=mean_flow))
    for rate, count in ((10, 4), (20, 7)):
        found = read_reference(f"{tmp_path / 'frames'}#t=0,0.3&fps={rate}", parts, Reading())
        assert (len(found), len(found.features)) == (count, count)
    for _ in range(2):  # told of what is read and of what was read before
        assert ASSUMED in read_reference(str(tmp_path / "frames"), parts, Reading(frames=2)).flags


def test_the_folder_of_a_run_is_the_frames_it_has_kept_and_not_its_pictures(
    mean_flow: tuple[str, ...], tiny_run: Path
) -> None:
    assert (tiny_run / "strip.jpg").is_file()  # a picture in the folder makes no folder of images of it
    found = read_reference(str(tiny_run), Components.build(load_config(overrides=mean_flow)), Reading())
    assert found.name == tiny_run.name
    assert found.image is not None
    assert torch.equal(found.image, read_clip(tiny_run / "video" / "frames.mkv").image)
