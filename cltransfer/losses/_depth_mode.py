"""Representative depth of a layer: the mode of its depths (paper Eq. 10)."""

from __future__ import annotations

import torch
from torch import Tensor

from ..computer.arrays import plain


def depth_mode(depth: Tensor, masks: Tensor) -> Tensor:
    """Most probable depth under each mask (paper Eq. 10).

    The density is a Gaussian KDE over log depth, so that the mode is the same whether a network gives depth or its
    inverse. Eq. 10 has it over depth, whose mode is nearer where a layer is spread out (of depths even from 5 to 50 at
    24, here at 42; of a wall that is slanted by a tenth). The paper names neither kernel nor bandwidth: here a
    256-bin histogram, bandwidth the larger of Scott's rule and 1 % of the range, peak refined below a bin.
    Scott's rule counts the pixels as in a frame of 160x90, so that the mode does not move with the resolution.
    A constant depth is its own mode; of equally high peaks the nearest to the median counts.

    Args:
        depth: (B, H, W), > 0, any unit; other values (NaN, infinite, <= 0) are left out.
        masks: K masks a frame, (B, K, H, W) bool.

    Returns:
        (B, K) float64, unit of ``depth``; NaN where a mask holds no depth.

    Raises:
        ValueError: depth and masks are not on one grid.

    >>> depth_mode(torch.full((1, 2, 2), 3.0), torch.ones(1, 1, 2, 2, dtype=torch.bool))
    tensor([[3.0000]], dtype=torch.float64)
    """
    from ._kernels import depth_modes

    _check_grid(depth, masks)
    return torch.from_numpy(depth_modes(plain(depth), plain(masks))).to(depth.device)


def nearest_peak(depth: Tensor, masks: Tensor, wanted: Tensor) -> Tensor:
    """Peak of that density nearest to a depth that is wanted, of those at least a fifth as high as the highest.

    Both change smoothly as the camera moves, where the mode jumps: it is that peak while its lead is below 0.

    Args:
        depth: as in :func:`depth_mode`.
        masks: as in :func:`depth_mode`.
        wanted: (B, K), > 0, unit of ``depth``; NaN where none is.

    Returns:
        (B, K, 2) float64: the peak, unit of ``depth``, and the log of the height of the highest other one over its own,
        minus infinity where it is alone. NaN where nothing is wanted or a mask holds no depth.

    Raises:
        ValueError: depth and masks are not on one grid.
    """
    from ._kernels import depth_peaks

    _check_grid(depth, masks)
    return torch.from_numpy(depth_peaks(plain(depth), plain(masks), plain(wanted.double()))).to(depth.device)


def _check_grid(depth: Tensor, masks: Tensor) -> None:
    if depth.shape != (len(masks), *masks.shape[2:]):
        raise ValueError(f"depth and masks must share a grid, got {tuple(depth.shape)} and {tuple(masks.shape)}")
