"""Sets whose images have several sizes: a dot drawn where a point projects is found where the read camera says."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from kornia.geometry.conversions import rotation_matrix_to_quaternion

from cltransfer.camera import Camera
from cltransfer.fit._views import views_of
from cltransfer.scenes.posed import PosedImages, named_camera, read_posed
from cltransfer.scenes.posed.lens import Lens

SIZES = ((640, 480), (640, 480), (320, 240), (480, 640), (900, 300))  # most, half of it, upright, a panorama
FOCALS = (500.0, 500.0, 260.0, 520.0, 480.0)
POINTS = torch.tensor([[0.1, -0.15, 0.2], [-0.2, 0.1, 0.0]], dtype=torch.float64)


def truth() -> list[Camera]:
    eyes = torch.tensor([[3.0, 1, -4], [-2, 2, -3], [1, -1, 5], [0, 3, 2], [-3, -2, 1]], dtype=torch.float64)
    cameras = Camera.look_at(eyes, torch.zeros(3), torch.tensor([0.0, 0, 1]), 1.0, (2, 2))
    shots = []
    for i, (size, focal) in enumerate(zip(SIZES, FOCALS)):
        K = torch.tensor([[[focal, 0, size[0] / 2 + 7], [0, 1.1 * focal, size[1] / 2 - 5], [0, 0, 1]]]).double()
        shots.append(Camera(cameras.w2c[i : i + 1], K, size))
    return shots


def write_model(root: Path, bend: float) -> None:
    """A COLMAP model with a camera, OPENCV where ``bend`` is its k1, for each image."""
    cameras, images = struct.pack("<Q", len(SIZES)), struct.pack("<Q", len(SIZES))
    for i, shot in enumerate(truth()):
        K = shot.K[0].numpy()
        lens = (K[0, 0], K[1, 1], K[0, 2], K[1, 2], bend, 0.0, 0.0, 0.0)
        cameras += struct.pack("<IiQQ8d", i + 1, 4, *shot.size, *lens)
        turn = rotation_matrix_to_quaternion(shot.w2c[:, :3, :3])[0].tolist()
        images += struct.pack("<I7dI", i + 1, *turn, *shot.w2c[0, :3, 3].tolist(), i + 1)
        images += f"{i}.png".encode() + b"\0" + struct.pack("<Q", 0)
        write_image(root / "images" / f"{i}.png", shot, K, bend)
    model = root / "sparse" / "0"
    model.mkdir(parents=True)
    (model / "cameras.bin").write_bytes(cameras)
    (model / "images.bin").write_bytes(images)


def write_image(path: Path, shot: Camera, K: np.ndarray, bend: float) -> None:
    """A red and a green dot."""
    path.parent.mkdir(parents=True, exist_ok=True)
    turn, _ = cv2.Rodrigues(shot.w2c[0, :3, :3].numpy())
    distortion = np.array([bend, 0, 0, 0])
    centred = K - np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
    pixels, _ = cv2.projectPoints(POINTS.numpy(), turn, shot.w2c[0, :3, 3].numpy(), centred, distortion)
    image = np.zeros((shot.size[1], shot.size[0], 3), np.uint8)
    for channel, (x, y) in zip((2, 1), pixels[:, 0]):
        dot = np.zeros(image.shape[:2], np.uint8)
        cv2.circle(dot, (round(x * 16), round(y * 16)), 6 * 16, 255, -1, cv2.LINE_AA, shift=4)
        image[..., channel] = dot
    cv2.imwrite(str(path), image)


@pytest.mark.parametrize("bend", [0.0, -0.1])
@pytest.mark.parametrize("side", [640, 200])
def test_every_image_shows_the_points_where_its_camera_projects_them(tmp_path, bend, side):
    write_model(tmp_path, bend)
    posed = read_posed(tmp_path)
    assert posed.camera.size == (640, 480)
    check(posed, side)


@pytest.mark.parametrize("bend", [0.0, -0.1])
def test_images_smaller_than_their_lenses_show_the_points_as_well(tmp_path, bend):
    write_model(tmp_path, bend)
    for i, (width, height) in enumerate(SIZES[2:], start=2):
        path = str(tmp_path / "images" / f"{i}.png")
        small = round(width / 3), round(height / 3)
        cv2.imwrite(path, cv2.resize(cv2.imread(path), small, interpolation=cv2.INTER_AREA))
    check(read_posed(tmp_path), 200)


def check(posed: PosedImages, side: int) -> None:
    """Every image has its dots where its camera projects the points."""
    camera, image = posed.images(range(len(posed)), side)
    assert image.shape == (5, 3, 3 * side // 4, side)
    wanted, _ = camera.project(POINTS)
    y, x = torch.meshgrid(*(torch.arange(n) + 0.5 for n in image.shape[2:]), indexing="ij")
    for i in range(len(posed)):
        for point in range(2):
            weight = image[i, point].double()
            assert weight.sum() > 0
            found = torch.stack([(weight * x).sum(), (weight * y).sum()]) / weight.sum()
            assert float((found - wanted[i, point]).norm()) < 0.5, (i, point)


def test_images_of_the_common_size_are_not_touched(tmp_path):
    write_model(tmp_path, 0.0)
    posed, shots = read_posed(tmp_path), truth()
    torch.testing.assert_close(posed.camera.K[:2], torch.cat([shot.K for shot in shots[:2]]))
    half = shots[2].K[0] * torch.tensor([2.0, 2, 1]).double()[:, None]
    torch.testing.assert_close(posed.camera.K[2], half)  # the same shape at half the size: nothing is cut off


@pytest.mark.parametrize("bend", [0.0, -0.1])
def test_a_camera_that_is_named_sees_all_of_its_image_at_its_own_size(tmp_path, bend):
    write_model(tmp_path, bend)
    for i, shot in enumerate(truth()):
        camera = named_camera(f"{tmp_path}:{i}", "--init")
        assert camera.size == shot.size
        torch.testing.assert_close(camera.w2c, shot.w2c)
        lens = Lens(shot.size, tuple(shot.K[0].diag()[:2].tolist()), tuple(shot.K[0, :2, 2].tolist()), (bend, 0, 0, 0))
        torch.testing.assert_close(camera.K[0], torch.from_numpy(lens.straight_matrix()))


def test_a_fit_takes_them_all(tmp_path):
    write_model(tmp_path, 0.0)
    views = views_of(read_posed(tmp_path), 64)
    assert views.image.shape == (5, 3, 48, 64)
