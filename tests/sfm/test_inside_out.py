"""Models that are turned inside out, and which of two is believed."""

from __future__ import annotations

import numpy as np
import pycolmap
import pytest

from cltransfer.sfm import load_pycolmap
from cltransfer.sfm.corners import Corners
from cltransfer.sfm.inside_out import sharp, turned
from cltransfer.sfm.mapping import Clues, _chosen

SIZE, FOCAL = (480, 270), 480.0


def model(noise: float) -> pycolmap.Reconstruction:
    """Five cameras that move a little past 80 points at 2 to 8, corners off by ``noise`` [px]."""
    load_pycolmap()  # silent
    random = np.random.default_rng(0)
    places = np.stack([random.uniform(-1, 1, 80), random.uniform(-0.5, 0.5, 80), random.uniform(2, 8, 80)], axis=1)
    made = pycolmap.Reconstruction()
    params = [FOCAL, SIZE[0] / 2, SIZE[1] / 2]
    camera = pycolmap.Camera(model="SIMPLE_PINHOLE", width=SIZE[0], height=SIZE[1], params=params, camera_id=1)
    made.add_camera_with_trivial_rig(camera)
    for number in range(1, 6):
        eye = np.array([0.05 * number, 0.02 * number**2, 0.0])
        pixels = (places - eye)[:, :2] / (places - eye)[:, 2:] * FOCAL + params[1:]
        image = pycolmap.Image(name=str(number), camera_id=1, image_id=number)
        image.points2D = pycolmap.Point2DList([
            pycolmap.Point2D(each) for each in pixels + noise * random.standard_normal(pixels.shape)
        ])  # fmt: skip
        made.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pycolmap.Rotation3d(), -eye))
    for index, place in enumerate(places):
        track = pycolmap.Track()
        for number in range(1, 6):
            track.add_element(number, index)
        made.add_point3D(place, track)
    return made


def depths(of: pycolmap.Reconstruction) -> np.ndarray:
    w2c = of.image(3).cam_from_world().matrix()
    return np.array([w2c[2, :3] @ point.xyz + w2c[2, 3] for _, point in sorted(of.points3D.items())])


def test_of_two_models_the_blurred_one_is_not_believed():
    clear, blurred = model(0.2), model(0.5)
    assert sharp([blurred, clear]) == [clear]
    assert sharp([clear, blurred]) == [clear]


@pytest.mark.filterwarnings("error")
def test_points_that_no_camera_can_see_are_explained_worst():
    right, odd = model(0.2), model(0.2)
    for number in range(1, 60):
        odd.points3D[number].xyz = np.array([0.0, 0.0, -1.0 if number % 2 else 0.0])
    assert sharp([odd, right]) == [right]
    assert turned(pycolmap, odd, (0.0, np.inf), refine=False) is None  # too few are left to place cameras by


def test_models_that_are_as_good_are_both_believed():
    both = [model(0.2), model(0.22)]
    assert sharp(both) == both


def test_a_model_is_turned_and_back_and_left_as_it_is():
    right = model(0.1)
    before = depths(right)
    wrong = turned(pycolmap, right, (0.1, 10.0), refine=False)
    assert np.array_equal(depths(right), before)
    assert np.corrcoef(np.log(depths(wrong)), np.log(before))[0, 1] < -0.3
    assert sharp([wrong, right]) == [right]
    back = turned(pycolmap, wrong, (0.1, 10.0), refine=False)
    assert np.corrcoef(np.log(depths(back)), np.log(before))[0, 1] > 0.9
    assert back.camera(1).focal_length == pytest.approx(FOCAL)


def test_the_blurred_one_is_not_chosen_though_its_lens_is_the_more_ordinary():
    clear, blurred = model(0.2), model(0.5)
    clear.camera(1).focal_length *= 1.001
    clues = Clues(SIZE, [Corners(np.zeros((0, 2)), np.zeros((0, 128)), np.zeros(0, bool))] * 5, [])
    assert _chosen(clues, [blurred, clear]) is clear


def test_a_lens_that_there_is_not_is_no_model():
    assert turned(pycolmap, model(0.1), (2.0, 10.0), refine=False) is None
