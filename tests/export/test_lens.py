"""What camera files of other programs share."""

from pathlib import Path

import pytest
import torch

from cltransfer.camera import Camera, intrinsics, resized
from cltransfer.export.lens import Lens, at_side, filmable, frame_numbers, millimetres, rate_of
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


def on_pixels(path: Trajectory, size: tuple[int, int]) -> Trajectory:
    """Of a lens that stands off the middle, pixels that are not square."""
    K = path.camera.K.clone()
    K[:, 0, 2] += (size[0] - path.camera.size[0]) / 2
    K[:, 1, 2] += (size[1] - path.camera.size[1]) / 2
    K[:, 0, 0] *= 1.5
    return Trajectory(Camera(path.camera.w2c, K, size), path.times)


@pytest.mark.parametrize(
    ("size", "side", "made"),
    [((720, 405), 1921, (1921, 1081)), ((405, 720), 64, (36, 64)), ((1281, 1), 16, (16, 1))],
)
def test_a_picture_of_another_size_is_as_high(
    path: Trajectory, size: tuple[int, int], side: int, made: tuple[int, int]
) -> None:
    """The lens stands off the middle by as much of the height."""
    before = on_pixels(path, size)
    after = at_side(before, side)
    assert after.camera.size == made
    assert torch.equal(after.times, before.times)
    torch.testing.assert_close(after.camera.vertical_fov, before.camera.vertical_fov)
    places = []
    for camera in (before.camera, after.camera):
        middle = torch.tensor(camera.size, dtype=torch.float64) / 2
        places.append((camera.project(path.camera.center[[0, 2]] + 5)[0] - middle) / camera.size[1])
    torch.testing.assert_close(*places)


@pytest.mark.parametrize(
    ("size", "made"), [((1281, 721), (1282, 722)), ((720, 405), (720, 406)), ((405, 720), (406, 720)), ((1, 1), (2, 2))]
)
def test_a_picture_of_a_film_is_even_and_has_the_same_pixels(
    path: Trajectory, size: tuple[int, int], made: tuple[int, int]
) -> None:
    before = on_pixels(path, size)
    points = path.camera.center[[0, 2]] + 5
    seen = before.camera.project(points)[0]
    for centred in (False, True):
        after = filmable(before, centred)
        assert after.camera.size == made
        assert torch.equal(after.times, before.times)
        beside = (seen.new_tensor(made) - seen.new_tensor(size)) / 2 * centred
        torch.testing.assert_close(after.camera.project(points)[0], seen + beside)


def test_a_row_more_changes_no_millimetres(path: Trajectory, tmp_path: Path) -> None:
    square = Trajectory(resized(path.camera, (720, 405)), path.times)
    for centred in (False, True):
        assert torch.equal(Lens.of(filmable(square, centred).camera, tmp_path).focal, millimetres(square.camera))


def test_a_picture_that_is_as_it_is_to_be_stays_so(path: Trajectory) -> None:
    assert filmable(path) is path
    assert at_side(path, 1280) is path


def test_a_path_that_does_not_begin_at_0_is_numbered_from_its_first_frame(still: Trajectory) -> None:
    camera = Camera(still.camera.w2c.expand(3, 4, 4), still.camera.K.expand(3, 3, 3), still.camera.size)
    late = Trajectory(camera, 5.0 + torch.tensor([0.0, 0.5, 0.75], dtype=torch.float64))
    assert frame_numbers(late, 24.0) == [0.0, 12.0, 18.0]
