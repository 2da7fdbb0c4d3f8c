import numpy as np
import pytest

from cltransfer.extractors._heatmaps import dark_offset, peaks, quarter_offset, simcc_joints


def gaussians(places, size=(48, 64), sigma=2.0):
    """Heatmaps (N, K, H, W) float32 with a Gaussian at each of places (N, K, 2)."""
    y, x = np.mgrid[: size[1], : size[0]]
    squared = (x - places[..., 0, None, None]) ** 2 + (y - places[..., 1, None, None]) ** 2
    return np.exp(-squared / (2 * sigma**2)).astype(np.float32)


def planted(seed=0):
    """Places of two persons' five joints, away from the border."""
    return np.random.default_rng(seed).uniform([8, 8], [40, 56], (2, 5, 2))


def test_dark_finds_the_middle_of_a_gaussian():
    maps = gaussians(planted())
    places, values = peaks(maps)
    np.testing.assert_allclose(places + dark_offset(maps, places), planted(), atol=0.02)
    assert (values > 0.85).all()


def test_dark_finds_the_middle_of_a_slanted_gaussian():
    y, x = np.mgrid[:64, :48]
    u, v = x - 20.3, y - 30.7
    maps = np.exp(-(u**2 + 1.2 * u * v + v**2) / 9).astype(np.float32)[None, None]
    places, _ = peaks(maps)
    np.testing.assert_allclose((places + dark_offset(maps, places))[0, 0], [20.3, 30.7], atol=0.05)


def test_a_quarter_offset_goes_towards_the_higher_neighbour_of_each_axis():
    maps = gaussians(np.array([[[20.2, 30.4], [19.8, 30.4], [20.0, 29.7]]]))
    places, _ = peaks(maps)
    offset = quarter_offset(maps, places)[0]
    np.testing.assert_array_equal(offset, [[0.25, 0.25], [-0.25, 0.25], [0, -0.25]])


@pytest.mark.parametrize("refine", [quarter_offset, dark_offset])
def test_a_peak_on_the_border_or_a_flat_map_is_not_moved(refine):
    maps = np.concatenate(
        [gaussians(np.array([[[0.0, 30.0], [47.0, 63.0]]])), np.full((1, 2, 64, 48), 0.5, np.float32)]
    )
    places, _ = peaks(maps)
    assert places[0].tolist() == [[0, 30], [47, 63]]
    np.testing.assert_array_equal(refine(maps, places), 0)


def test_dark_leaves_a_place_that_is_no_top_where_it_is():
    y, x = np.mgrid[:64, :48]
    bowl = (1 + 0.01 * ((x - 20.3) ** 2 + (y - 30.7) ** 2)).astype(np.float32)[None, None]
    np.testing.assert_array_equal(dark_offset(bowl, np.array([[[20, 31]]])), 0)


def test_simcc_reads_both_axes_in_pixels_and_scores_the_less_sure_one():
    x, y = np.zeros((1, 2, 384), np.float32), np.zeros((1, 2, 512), np.float32)
    x[0, 0, 101], y[0, 0, 300], x[0, 1, 380], y[0, 1, 7] = 0.9, 0.6, 0.3, 0.8
    places, scores = simcc_joints(x, y, (192, 256))
    assert places[0].tolist() == [[50.5, 150.0], [190.0, 3.5]]
    np.testing.assert_allclose(scores[0], [0.6, 0.3])
