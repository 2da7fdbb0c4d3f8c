"""Inner loops of the losses: one pass over the pixels of a batch."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..computer.compiled import kernel

BINS = 256
PIXELS = 160 * 90  # Scott's rule counts a layer's pixels as in a frame of this many
FLOOR = 0.01  # least bandwidth, as a part of the range of log depth
FAINT = 0.2  # part of the highest that a peak is high at least
TIE = 1e-6  # peaks that differ by less than this part of the highest count as equally high


@kernel(nogil=True)
def _bin_linearly(values: NDArray, low: float, step: float, histogram: NDArray) -> None:
    """Share each value between its two nearest bin centres, ``low + i * step``."""
    for value in values:
        place = (value - low) / step
        i = min(int(place), BINS - 2)
        histogram[i] += i + 1 - place
        histogram[i + 1] += place - i


@kernel(nogil=True)
def _smooth(histogram: NDArray, sigma: float) -> NDArray:
    """Histogram convolved with a Gaussian of ``sigma`` bins, cut at 4 sigma."""
    reach = min(int(4 * sigma) + 1, BINS - 1)
    weights = np.exp(-0.5 * (np.arange(reach + 1) / sigma) ** 2)
    density = np.zeros(BINS)
    for i in range(BINS):
        if histogram[i] > 0:
            for j in range(max(0, i - reach), min(BINS, i + reach + 1)):
                density[j] += histogram[i] * weights[abs(i - j)]
    return density


@kernel(nogil=True)
def _highest(density: NDArray, median: float) -> int:
    """Bin of the highest peak; of equal ones the nearest to ``median`` [bins]."""
    limit = density.max() * (1 - TIE)
    best = -1
    for i in range(BINS):
        if density[i] >= limit and (best < 0 or abs(i - median) < abs(best - median)):
            best = i
    return best


@kernel(nogil=True)
def _refined(density: NDArray, i: int) -> tuple[float, float]:
    """Place [bins] and height of the peak about bin ``i``, by a parabola."""
    if i == 0 or i == BINS - 1:
        return float(i), density[i]
    before, peak, after = density[i - 1], density[i], density[i + 1]
    bend = before - 2 * peak + after
    if bend >= 0:
        return float(i), peak
    return i + 0.5 * (before - after) / bend, peak - 0.125 * (before - after) ** 2 / bend


@kernel(nogil=True)
def _density(values: NDArray, area: float, low: float, high: float) -> tuple[NDArray, float]:
    """Gaussian KDE of ``values``, (N,), at :data:`BINS` places from ``low`` to ``high``; bin of their median."""
    histogram, step = np.zeros(BINS), (high - low) / (BINS - 1)
    _bin_linearly(values, low, step, histogram)
    scott = values.std() * (PIXELS * area) ** -0.2
    density = _smooth(histogram, max(scott, FLOOR * (high - low)) / step)
    return density, float(np.searchsorted(np.cumsum(histogram), 0.5 * len(values)))


@kernel(nogil=True)
def mode_of_log(values: NDArray, area: float) -> float:
    """Mode of the Gaussian KDE of ``values``, (N,), N >= 1, on ``area`` in (0, 1] of the frame."""
    low, high = values.min(), values.max()
    if high - low < 1e-9:  # constant depth is its own mode
        return 0.5 * (low + high)
    step = (high - low) / (BINS - 1)
    density, median = _density(values, area, low, high)
    return low + step * _refined(density, _highest(density, median))[0]


@kernel(nogil=True)
def peak_of_log(values: NDArray, area: float, wanted: float) -> tuple[float, float]:
    """Peak of that density nearest to ``wanted``, of those not faint, and log of the highest other one over it."""
    low, high = values.min(), values.max()
    if high - low < 1e-9:
        return 0.5 * (low + high), -math.inf
    step = (high - low) / (BINS - 1)
    density, _ = _density(values, area, low, high)
    least = FAINT * density.max()
    nearest, height, other = math.inf, 0.0, 0.0
    for i in range(BINS):
        left = density[i - 1] if i > 0 else -1.0
        right = density[i + 1] if i < BINS - 1 else -1.0
        if density[i] < least or density[i] < left or density[i] <= right:
            continue
        place, peak = _refined(density, i)
        if abs(low + step * place - wanted) < abs(nearest - wanted):
            nearest, height, peak = low + step * place, peak, height
        other = max(other, peak)
    return nearest, math.log(other / height) if other > 0 else -math.inf


@kernel(nogil=True)
def _logs(depth: NDArray, mask: NDArray, values: NDArray) -> int:
    """Logs of the depths (H, W) > 0 under a mask (H, W) bool, the first of ``values``, (H W,); how many they are."""
    count = 0
    for y in range(depth.shape[0]):
        for x in range(depth.shape[1]):
            d = depth[y, x]
            if mask[y, x] and d > 0 and d < math.inf:
                values[count] = math.log(d)
                count += 1
    return count


@kernel(nogil=True)
def depth_modes(depth: NDArray, masks: NDArray) -> NDArray:
    """Modes (B, K) of depth (B, H, W) under masks (B, K, H, W) bool; NaN where a mask holds no depth > 0."""
    batch, layers, height, width = masks.shape
    modes = np.full((batch, layers), np.nan)
    values = np.empty(height * width)
    for b in range(batch):
        for k in range(layers):
            count = _logs(depth[b], masks[b, k], values)
            if count > 0:
                modes[b, k] = math.exp(mode_of_log(values[:count], count / len(values)))
    return modes


@kernel(nogil=True)
def depth_peaks(depth: NDArray, masks: NDArray, wanted: NDArray) -> NDArray:
    """Peaks nearest to ``wanted`` (B, K) of depth (B, H, W) under masks (B, K, H, W) bool, and their leads, (B, K, 2).

    NaN where nothing is wanted or a mask holds no depth > 0.
    """
    batch, layers, height, width = masks.shape
    found = np.full((batch, layers, 2), np.nan)
    values = np.empty(height * width)
    for b in range(batch):
        for k in range(layers):
            count = _logs(depth[b], masks[b, k], values) if wanted[b, k] > 0 else 0
            if count > 0:
                place, lead = peak_of_log(values[:count], count / len(values), math.log(wanted[b, k]))
                found[b, k] = math.exp(place), lead
    return found


@kernel(nogil=True)
def flow_sums(flow: NDArray, weight: NDArray, layers: NDArray) -> NDArray:
    """Weighted sums (B, K, 12) over each layer's pixels that have a flow.

    Of 1, u, v, uu, uv, vv, then of each flow component times 1, u, v. Coordinates (u, v) run over the frame
    from -0.5 to 0.5. ``flow`` is (B, 2, H, W), ``weight`` (B, H, W) >= 0, ``layers`` (B, K, H, W) bool.
    """
    batch, count, height, width = layers.shape
    sums, across = np.zeros((batch, count, 12)), (np.arange(width) + 0.5) / width - 0.5
    for b in range(batch):
        for y in range(height):
            v = (y + 0.5) / height - 0.5
            for k in range(count):
                n, nu, nuu, nx, nxu, ny, nyu = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0  # of the row, along which v is one
                for x in range(width):
                    w, fx, fy = float(weight[b, y, x]), flow[b, 0, y, x], flow[b, 1, y, x]
                    if layers[b, k, y, x] and w > 0 and math.isfinite(fx) and math.isfinite(fy):  # w may be NaN
                        wu = w * across[x]
                        n += w
                        nu += wu
                        nuu += wu * across[x]
                        nx += w * fx
                        nxu += wu * fx
                        ny += w * fy
                        nyu += wu * fy
                s = sums[b, k]
                for i, value in enumerate((n, nu, v * n, nuu, v * nu, v * v * n, nx, nxu, v * nx, ny, nyu, v * ny)):
                    s[i] += value
    return sums
