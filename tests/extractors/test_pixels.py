import numpy as np
import torch

from cltransfer.extractors._pixels import normalised, to_uint8


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
