"""What camera files of other programs share."""

from pathlib import Path

import pytest
import torch

from cltransfer.camera import Camera, intrinsics
from cltransfer.export.lens import Lens, millimetres, rate_of
from cltransfer.trajectory import Trajectory


@pytest.mark.parametrize(("fps", "rate"), [(2.0, 24.0), (12.0, 12.0), (30.0, 30.0)])
def test_a_path_of_some_frames_of_a_clip_is_numbered_by_a_usual_rate(
    still: Trajectory, fps: float, rate: float
) -> None:
    camera = Camera(still.camera.w2c.expand(4, 4, 4), still.camera.K.expand(4, 3, 3), still.camera.size)
    assert rate_of(Trajectory(camera, torch.arange(4, dtype=torch.float64) / fps)) == pytest.approx(rate)


def test_millimetres_are_those_of_the_width_whatever_the_height(still: Trajectory, tmp_path: Path) -> None:
    focal = torch.tensor([50.0, 100.0], dtype=torch.float64)
    both = Camera(still.camera.w2c.expand(2, 4, 4), intrinsics(focal, (200, 400)), (200, 400))
    assert millimetres(both).tolist() == Lens.of(both, tmp_path).focal.tolist() == [9.0, 18.0]
