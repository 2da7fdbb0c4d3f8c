"""What camera files of other programs share."""

from pathlib import Path

import pytest
import torch

from cltransfer.camera import Camera, intrinsics
from cltransfer.export.lens import Lens, filmable, frame_numbers, millimetres, rate_of
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


@pytest.mark.parametrize(
    ("size", "side", "made"),
    [((1281, 721), None, (1280, 720)), ((720, 405), None, (720, 404)), ((720, 405), 1921, (1920, 1080)),
     ((405, 720), 64, (36, 64)), ((1281, 1), 16, (16, 2))],
)  # fmt: skip
def test_a_picture_of_another_size_is_even_and_as_high(
    path: Trajectory, size: tuple[int, int], side: int | None, made: tuple[int, int]
) -> None:
    """The lens stands off the middle: it does so by as much of the height."""
    K = path.camera.K.clone()
    K[:, 0, 2] += (size[0] - path.camera.size[0]) / 2
    K[:, 1, 2] += (size[1] - path.camera.size[1]) / 2
    K[:, 0, 0] *= 1.5
    before = Trajectory(Camera(path.camera.w2c, K, size), path.times)
    after = filmable(before, side)
    assert after.camera.size == made
    assert torch.equal(after.times, before.times)
    torch.testing.assert_close(after.camera.vertical_fov, before.camera.vertical_fov)
    places = []
    for camera in (before.camera, after.camera):
        middle = torch.tensor(camera.size, dtype=torch.float64) / 2
        places.append((camera.project(path.camera.center[[0, 2]] + 5)[0] - middle) / camera.size[1])
    torch.testing.assert_close(*places)


def test_a_picture_that_is_even_already_stays_as_it_is(path: Trajectory) -> None:
    assert filmable(path) is path
    assert filmable(path, 1280) is path


def test_a_path_that_does_not_begin_at_0_is_numbered_from_its_first_frame(still: Trajectory) -> None:
    camera = Camera(still.camera.w2c.expand(3, 4, 4), still.camera.K.expand(3, 3, 3), still.camera.size)
    late = Trajectory(camera, 5.0 + torch.tensor([0.0, 0.5, 0.75], dtype=torch.float64))
    assert frame_numbers(late, 24.0) == [0.0, 12.0, 18.0]
