"""The representative depth of a layer, against SciPy's kernel density estimate."""

import time
from collections.abc import Callable

import numpy as np
import pytest
import torch
from scipy.signal import find_peaks
from scipy.stats import gaussian_kde

from cltransfer.losses._depth_mode import depth_mode, nearest_peak


def mode_of(values: np.ndarray) -> float:
    depth = torch.from_numpy(np.asarray(values, dtype=np.float64)).reshape(1, 1, -1)
    return float(depth_mode(depth, torch.ones(1, 1, *depth.shape[1:], dtype=torch.bool)))


def peak_of(values: np.ndarray, wanted: float) -> tuple[float, float]:
    """Peak nearest to the one wanted, and its lead."""
    depth = torch.from_numpy(np.asarray(values, dtype=np.float64)).reshape(1, 1, -1)
    found = nearest_peak(depth, torch.ones(1, 1, *depth.shape[1:], dtype=torch.bool), torch.tensor([[wanted]]))
    return float(found[0, 0, 0]), float(found[0, 0, 1])


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


@pytest.mark.parametrize("seed", range(5))
def test_peaks_and_their_leads_are_those_of_scipys_kde(seed: int) -> None:
    random = np.random.default_rng(seed)
    parts = [random.normal(place, 0.1, 300 + 60 * seed * i) for i, place in enumerate((0.2, 1.1, 2.0))]
    values = np.concatenate(parts)
    grid = np.linspace(values.min(), values.max(), 4001)
    nominal = (160 * 90) ** -0.2 * values.std() / values.std(ddof=1)
    density = gaussian_kde(values, bw_method=nominal)(grid)
    peaks = find_peaks(density, height=0.2 * density.max(), prominence=0.01 * density.max())[0]
    assert len(peaks) >= 3
    for at in peaks:
        place, lead = peak_of(np.exp(values), float(np.exp(grid[at])))
        assert np.log(place) == pytest.approx(grid[at], abs=0.2 * np.ptp(values) / 255)
        assert lead == pytest.approx(np.log(density[peaks[peaks != at]].max() / density[at]), abs=0.02)


def test_the_mode_is_the_peak_without_a_lead() -> None:
    values = np.exp(np.repeat([0.0, 2.0, 5.0], [200, 20, 150]))
    assert peak_of(values, 0.9) == pytest.approx((mode_of(values), np.log(150 / 200)))
    assert peak_of(values, 100.0) == pytest.approx((np.exp(5.0), np.log(200 / 150)))


def test_a_peak_less_than_a_fifth_as_high_is_none() -> None:
    values = np.exp(np.repeat([0.0, 2.0, 5.0], [200, 20, 50]))
    assert peak_of(values, np.exp(2.0)) == pytest.approx((1.0, np.log(50 / 200)))


def test_a_single_peak_leads_by_all() -> None:
    assert peak_of(np.full(50, 3.7), 1.0) == (pytest.approx(3.7, rel=1e-12), -np.inf)
    assert peak_of(np.exp(np.linspace(-1, 1, 2000) ** 3), 3.0) == (pytest.approx(1.0, abs=0.01), -np.inf)


def test_what_is_not_wanted_or_not_there_has_no_peak() -> None:
    depth, masks = torch.full((2, 4, 4), 2.0), torch.ones(2, 2, 4, 4, dtype=torch.bool)
    masks[0, 1] = False
    wanted = torch.tensor([[1.0, 1.0], [torch.nan, 3.0]])
    found = nearest_peak(depth, masks, wanted)
    assert found.isnan().all(-1).tolist() == [[False, True], [True, False]]
    for b, k in ((0, 0), (1, 1)):
        assert found[b, k].tolist() == [pytest.approx(2.0, rel=1e-8), -np.inf]


@pytest.mark.parametrize("of", [depth_mode, lambda depth, masks: nearest_peak(depth, masks, torch.ones(1, 3))])
def test_depth_and_masks_on_two_grids_are_refused(of: Callable[[torch.Tensor, torch.Tensor], torch.Tensor]) -> None:
    with pytest.raises(ValueError, match="depth and masks must share a grid"):
        of(torch.ones(1, 8, 8), torch.ones(1, 3, 4, 8, dtype=torch.bool))


def test_takes_less_than_a_millisecond_a_frame(within: Callable[[float, float], bool]) -> None:
    depth = torch.rand(10, 90, 160, generator=torch.Generator().manual_seed(0)) + 1
    masks = torch.stack([depth < 1.2, (depth >= 1.2) & (depth < 1.5), depth >= 1.5], dim=1)
    depth_mode(depth, masks)
    seconds = []
    for _ in range(5):
        start = time.thread_time()
        depth_mode(depth, masks)
        seconds.append(time.thread_time() - start)
    assert within(min(seconds) / 10, 1e-3)
