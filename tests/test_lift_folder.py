from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import cv2
import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.config import load_config
from cltransfer.lift_folder import Lifting, _given, lift_to_folder
from cltransfer.registry import EXTRACTORS
from cltransfer.trajectory import Trajectory


@dataclass(frozen=True)
class All:
    """What a lift asks for, if it gets that far."""

    requires: ClassVar[tuple[str, ...]] = ("image",)
    provides: ClassVar[tuple[str, ...]] = ("box", "keypoints", "subject", "orientation")
    family: ClassVar[str] = "image"
    __call__: ClassVar[Any] = print


def test_meanwhile_threads_are_the_config_s(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def looked(step: str) -> None:
        raise KeyboardInterrupt(cv2.getNumThreads())

    monkeypatch.setitem(EXTRACTORS._classes, "all", All)
    others = [f"extractors.{name}=null" for name in load_config().extractors]
    config = load_config(overrides=[*others, "extractors.all={}", "threads=1"])
    cv2.setNumThreads(3)
    with pytest.raises(KeyboardInterrupt, match=r"^1$"):
        lift_to_folder(Lifting("builtin:plaza"), config, tmp_path, looked)
    assert cv2.getNumThreads() == 3


def test_views_of_unlike_shape_are_looked_from_whole(tmp_path: Path) -> None:
    up = torch.tensor([0.0, -1, 0])
    files = []
    for name, size in (("high", (90, 160)), ("wide", (160, 90))):
        camera = Camera.look_at(torch.tensor([[0.0, 0, -4]]), torch.zeros(1, 3), up, 0.8, size)
        Trajectory(camera, torch.tensor([0.0], dtype=torch.float64)).save(tmp_path / f"{name}.json")
        files.append(tmp_path / f"{name}.json")
    both = _given(tuple(files))
    assert both is not None
    assert both.size == (640, 1138)
    corner = torch.tensor([[4 * 0.42 * 160 / 90, 4 * 0.42, 0.0]])  # just inside the wide view
    pixels, _ = both.project(corner)
    assert 630 < float(pixels[1, 0, 0]) < 640
    assert _given(()) is None


def test_of_a_long_path_as_many_views_are_taken_as_every_pair_can_be_tried_of(tmp_path: Path) -> None:
    eye = torch.stack([torch.linspace(-1, 1, 300), torch.zeros(300), torch.full((300,), -4.0)], dim=1)
    camera = Camera.look_at(eye, torch.zeros(300, 3), torch.tensor([0.0, -1, 0]), 0.8, (160, 90))
    Trajectory(camera, torch.arange(300, dtype=torch.float64)).save(tmp_path / "long.json")
    taken = _given((tmp_path / "long.json",))
    assert taken is not None
    assert len(taken) == 64
    torch.testing.assert_close(taken.center[[0, -1]], camera.center[[0, -1]])
    assert float(taken.center.diff(dim=0).norm(dim=1).max()) < 2 / 55
