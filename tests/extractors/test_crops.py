import numpy as np
import torch

from cltransfer.extractors._crops import Crops, about_boxes
from cltransfer.extractors._pixels import to_uint8


def tilted(size=64):
    """Two crops, the second turned by 30 degrees to the right."""
    up = np.array([[0.0, -1.0], [0.5, -np.sqrt(0.75)]])
    return Crops(np.array([[50.0, 40.0], [47.5, 44.0]]), np.array([32.0, 48.0]), up, size)


def test_the_middle_and_the_top_of_a_crop_lie_where_it_was_put():
    points = tilted().to_frame(np.array([[32.0, 32.0], [32.0, 0.0]]))
    np.testing.assert_allclose(points[:, 0], tilted().center)
    np.testing.assert_allclose(points[:, 1], tilted().center + tilted().up * np.array([[16.0], [24.0]]))


def test_a_cut_shows_the_frame_at_the_points_to_frame_names():
    y, x = np.mgrid[:80, :100] + 0.5  # pixel centres
    images = np.stack([np.stack([2 * x, 2 * y, 0 * x], axis=-1)] * 2).astype(np.uint8)
    cuts = tilted().cut(images) / 2
    v, u = np.mgrid[8:56, 8:56] + 0.5
    points = tilted().to_frame(np.stack([u, v], axis=-1).reshape(1, -1, 2))
    seen = cuts[:, 8:56, 8:56, :2].reshape(2, -1, 2)
    assert np.abs((seen - points).mean(axis=1)).max() < 0.1


def test_a_smooth_cut_shows_the_frame_at_the_same_points_however_much_smaller_it_is():
    y, x = np.mgrid[:80, :100] + 0.5
    images = np.stack([np.stack([2 * x, 2 * y, 0 * x], axis=-1)] * 2).astype(np.uint8)
    for size in (16, 10):  # 2 and 3, 3.2 and 4.8 pixels of the frame to one
        v, u = np.mgrid[2 : size - 2, 2 : size - 2] + 0.5
        points = tilted(size).to_frame(np.stack([u, v], axis=-1).reshape(1, -1, 2))
        seen = tilted(size).cut(images, smooth=True)[:, 2:-2, 2:-2, :2].reshape(2, -1, 2) / 2
        assert np.abs((seen - points).mean(axis=1)).max() < 0.3
        assert np.abs(seen - points).max() < 1


def test_a_smooth_cut_of_stripes_is_their_mean():
    images = np.zeros((2, 80, 100, 3), np.uint8)
    images[:, ::2] = 200
    far, near = tilted(10), tilted(24)
    assert np.abs(far.cut(images, smooth=True)[:, 2:-2, 2:-2] - 100.0).max() < 40
    assert np.abs(far.cut(images)[0, 2:-2, 2:-2] - 100.0).max() > 70
    np.testing.assert_array_equal(near.cut(images, smooth=True)[0], near.cut(images)[0])  # 1.33 to one


def test_what_is_pasted_is_what_was_cut():
    y, x = np.mgrid[:80, :100].astype(np.float32)
    images = np.repeat(np.stack([100 + 50 * np.sin(x / 9) * np.cos(y / 7)] * 3, axis=-1)[None], 2, axis=0)
    crops = tilted()
    pasted = crops.paste(crops.cut(images.astype(np.uint8))[..., 0].astype(np.float32), (100, 80), -1.0)
    inside = pasted > 60  # beyond the crop it is -1, on its rim mixed
    assert (inside.sum((1, 2)) > np.array([0.8 * 32**2, 0.8 * 48**2])).all()
    assert np.abs(pasted - images[..., 0])[inside].mean() < 1.5


def test_squares_about_boxes_are_upright_and_centred():
    crops = about_boxes(np.array([[10.0, 20.0, 40.0, 100.0]]), 1.25, 256)
    np.testing.assert_allclose(crops.to_frame(np.array([[0, 0], [256.0, 256]]))[0], [[-32.5, 7.5], [92.5, 132.5]])


def test_to_uint8_rounds_and_keeps_the_order_of_channels():
    image = torch.tensor([0.0, 0.499 / 255, 0.501 / 255, 1.0]).reshape(1, 1, 2, 2).repeat(1, 3, 1, 1)
    image[:, 1] = 100 / 255
    got = to_uint8(image)
    assert got.shape == (1, 2, 2, 3)
    assert got[..., 0].flatten().tolist() == got[..., 2].flatten().tolist() == [0, 0, 1, 255]
    assert (got[..., 1] == 100).all()
