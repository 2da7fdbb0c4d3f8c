"""The representative depth of a layer, against SciPy's kernel density estimate."""

import time

import numpy as np
import pytest
import torch
from scipy.stats import gaussian_kde

from cltransfer.losses._depth_mode import depth_mode


def mode_of(values: np.ndarray) -> float:
    depth = torch.from_numpy(np.asarray(values, dtype=np.float64)).reshape(1, 1, -1)
    return float(depth_mode(depth, torch.ones(1, 1, *depth.shape[1:], dtype=torch.bool)))


@pytest.mark.parametrize("seed", range(5))
def test_mode_is_that_of_scipys_kde(seed: int) -> None:
    random = np.random.default_rng(seed)
    near = random.lognormal(0.5, 0.1 + 0.05 * seed, 900)
    far = random.lognormal(1.8, 0.2, 400 + 50 * seed)
    values = np.log(np.concatenate([near, far]))
    grid = np.linspace(values.min(), values.max(), 4001)
    nominal = (160 * 90) ** -0.2 * values.std() / values.std(ddof=1)
    expected = grid[gaussian_kde(values, bw_method=nominal)(grid).argmax()]
    assert np.log(mode_of(np.exp(values))) == pytest.approx(expected, abs=0.2 * np.ptp(values) / 255)


def test_constant_depth_is_its_own_mode_row_8() -> None:
    assert mode_of(np.full(50, 3.7)) == pytest.approx(3.7, rel=1e-12)
    assert mode_of(np.array([2.5])) == pytest.approx(2.5, rel=1e-12)


def test_ties_go_to_the_peak_nearest_the_median_row_8() -> None:
    values = np.repeat([0.0, 2.0, 5.0], [200, 20, 200])  # two equal peaks; the median is 2
    assert mode_of(np.exp(values)) == pytest.approx(1.0)
    assert mode_of(np.exp(5 - values)) == pytest.approx(np.exp(5.0))


def test_mode_follows_scale_and_inversion() -> None:
    values = np.random.default_rng(0).gamma(4.0, size=600)
    assert mode_of(1000 * values) == pytest.approx(1000 * mode_of(values), rel=1e-6)
    assert mode_of(1 / values) == pytest.approx(1 / mode_of(values), rel=1e-6)


def test_mode_does_not_move_with_the_resolution() -> None:
    values = np.random.default_rng(0).gamma(4.0, size=600)
    assert mode_of(np.repeat(values, 9)) == pytest.approx(mode_of(values), rel=1e-9)


def test_pixels_without_a_depth_are_left_out() -> None:
    depth = torch.full((1, 4, 4), 2.0)
    depth[0, 0] = torch.tensor([float("nan"), float("inf"), 0.0, -1.0])
    masks = torch.zeros(1, 3, 4, 4, dtype=torch.bool)
    masks[0, 0], masks[0, 1, 0] = True, True
    torch.testing.assert_close(
        depth_mode(depth, masks)[0], torch.tensor([2.0, torch.nan, torch.nan]).double(), equal_nan=True
    )


def test_depth_and_masks_on_two_grids_are_refused() -> None:
    with pytest.raises(ValueError, match="depth and masks must share a grid"):
        depth_mode(torch.ones(1, 8, 8), torch.ones(1, 3, 4, 8, dtype=torch.bool))


def test_takes_less_than_a_millisecond_a_frame(slowness: float) -> None:
    depth = torch.rand(10, 90, 160, generator=torch.Generator().manual_seed(0)) + 1
    masks = torch.stack([depth < 1.2, (depth >= 1.2) & (depth < 1.5), depth >= 1.5], dim=1)
    depth_mode(depth, masks)
    seconds = []
    for _ in range(5):
        start = time.thread_time()
        depth_mode(depth, masks)
        seconds.append(time.thread_time() - start)
    assert min(seconds) / 10 < 1e-3 * slowness
