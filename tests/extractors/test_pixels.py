import cv2
import numpy as np
import pytest
import torch

from cltransfer.extractors._pixels import normalised, resized, to_uint8


def test_normalised_is_channels_first_and_of_each_channel():
    rgb = np.zeros((2, 4, 5, 3), np.uint8)
    rgb[1, 2, 3] = 255, 51, 0
    planes = normalised(rgb, (0.5, 0.1, 0.0), (0.5, 0.1, 2.0))
    assert (planes.shape, planes.dtype) == ((2, 3, 4, 5), np.float32)
    np.testing.assert_allclose(planes[1, :, 2, 3], [1, 1, 0], atol=1e-6)
    np.testing.assert_allclose(planes[0, :, 0, 0], [-1, -1, 0], atol=1e-6)
    np.testing.assert_allclose(normalised(rgb)[0, :, 0, 0], [-2.1179, -2.0357, -1.8044], atol=1e-4)


def test_images_are_rounded_to_bytes_channels_last():
    image = torch.zeros(1, 3, 2, 3)
    image[0, :, 1, 2] = torch.tensor([1.0, 0.5, 0.25])
    pixels = to_uint8(image)
    assert pixels.shape == (1, 2, 3, 3)
    assert pixels[0, 1, 2].tolist() == [255, 128, 64]


def test_what_is_out_of_range_ends_at_black_and_white_and_all_else_is_rounded():
    image = torch.zeros(1, 3, 1, 4)
    image[0, 0, 0] = torch.tensor([-0.5, -1e-3, 2.0, 1.001])
    assert to_uint8(image)[0, 0, :, 0].tolist() == [0, 0, 255, 255]
    several = torch.rand(2, 3, 5, 7, generator=torch.Generator().manual_seed(0))
    np.testing.assert_array_equal(to_uint8(several), (several * 255).round().byte().permute(0, 2, 3, 1).numpy())


def noise(width, height):
    return np.random.default_rng(0).integers(0, 256, (2, height, width, 3), dtype=np.uint8)


def means_of_rows(rows, count):
    """Area means (count, ...) of ``rows`` (h, ...)."""
    edges = np.linspace(0, len(rows), count + 1)
    sums = np.concatenate([np.zeros_like(rows[:1], float), rows.cumsum(0, dtype=float)])
    whole = np.minimum(edges.astype(int), len(rows) - 1)
    upto = sums[whole] + rows[whole] * (edges - whole)[:, None]
    return np.diff(upto, axis=0) * count / len(rows)


@pytest.mark.parametrize("growing", [cv2.INTER_LINEAR, cv2.INTER_CUBIC, cv2.INTER_AREA])
@pytest.mark.parametrize(("old", "new"), [((480, 908), (768, 432)), ((908, 480), (432, 768))])
def test_where_one_axis_grows_every_row_of_the_other_counts(growing, old, new):
    levels = np.random.default_rng(0).integers(0, 256, (908, 3), dtype=np.uint8)
    images = np.tile(levels[None, :, None], (2, 1, 480, 1))
    turned = old[0] > old[1]
    got = resized(images.swapaxes(1, 2) if turned else images, new, growing)
    got = got.swapaxes(1, 2) if turned else got
    assert got.shape == (2, 432, 768, 3)
    assert np.abs(got - means_of_rows(levels, 432)[:, None]).max() < 1


@pytest.mark.parametrize("growing", [cv2.INTER_LINEAR, cv2.INTER_CUBIC, cv2.INTER_AREA])
@pytest.mark.parametrize(
    ("new", "shrinks"), [((40, 25), True), ((60, 25), True), ((90, 91), False), ((60, 91), False), ((60, 50), False)]
)
def test_where_no_axis_goes_the_other_way_one_step_does(growing, new, shrinks):
    images, how = noise(60, 50), cv2.INTER_AREA if shrinks else growing
    expected = np.stack([cv2.resize(image, new, interpolation=how) for image in images])
    np.testing.assert_array_equal(resized(images, new, growing), expected)
