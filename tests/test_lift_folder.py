from __future__ import annotations

from pathlib import Path

import torch

from cltransfer.camera import Camera
from cltransfer.lift_folder import _given
from cltransfer.trajectory import Trajectory


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
