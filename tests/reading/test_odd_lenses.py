from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from cltransfer.camera import Camera, intrinsics
from cltransfer.reading.odd_lenses import tell_beside, tell_oblong


def cameras(*offset: tuple[float, float], wider: float = 1.0) -> Camera:
    """Cameras of 200x100 with their principal points so far [px] from the middle; the last has ``wider`` times fx."""
    K = intrinsics(torch.full((len(offset),), 80.0, dtype=torch.float64), (200, 100))
    K[:, :2, 2] += torch.tensor(offset)
    K[-1, 0, 0] *= wider
    return Camera(torch.eye(4).double().repeat(len(offset), 1, 1), K, (200, 100))


def test_the_principal_point_that_lies_farthest_aside_is_told(caplog: pytest.LogCaptureFixture) -> None:
    tell_beside("a.json", cameras((0, 0), (1.9, -0.9)), "so it is")
    assert caplog.messages == []
    tell_beside("a.json", cameras((4, 0), (0, -20), (5, 3)), "so it is")
    got = "expected it in the middle, got +0.0% of the width and -20.0% of the height beside"
    assert caplog.messages == [f"a.json: principal point: {got}; so it is"]


@pytest.mark.parametrize(("wider", "told"), [(1.0, False), (1.009, False), (0.991, False), (1.5, True), (0.5, True)])
def test_pixels_that_are_not_square_are_told_of_whichever_camera(
    caplog: pytest.LogCaptureFixture, wider: float, told: bool
) -> None:
    camera = cameras((0, 0), (0, 0), wider=wider)
    assert tell_oblong("a.json", camera, "so it is") is told
    line = f"a.json: focal length: expected fx as fy, got {80 * wider:g} and 80; so it is"
    assert caplog.messages == [line] * told
    assert not tell_oblong("a.json", replace(camera, K=camera.K[:1], w2c=camera.w2c[:1]), "so it is")
