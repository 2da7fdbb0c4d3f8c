"""How far a flow can be trusted: the way there and back must lead home."""

from __future__ import annotations

import torch
from kornia.utils import create_meshgrid
from torch import Tensor
from torch.nn.functional import grid_sample

SHARE = 0.01  # squared miss allowed, of the squared lengths of both flows
SLACK = 0.5  # and beside it [px^2]


def round_trip_confidence(backward: Tensor, forward: Tensor) -> Tensor:
    """Confidence in a backward flow, by following the forward flow back from where it leads.

    The miss m is held against what Sundaram, Brox and Keutzer (https://doi.org/10.1007/978-3-642-15549-9_32, Eq. 5)
    allow, a = sqrt(0.01 (|b|^2 + |f|^2) + 0.5): the confidence is 2^-(m/a)^2, so 0.5 is their threshold. It is 0 where
    the flow leads out of the frame: nothing there tells whether it is right.

    Args:
        backward: frame i -> i-1 on the pixels of frame i, (B, 2, H, W) [px of this grid].
        forward: frame i-1 -> i on the pixels of frame i-1, (B, 2, H, W) [px of this grid].

    Returns:
        (B, H, W) in [0, 1]; NaN where either flow is.

    Raises:
        ValueError: the flows are not on one grid.
    """
    if backward.shape != forward.shape:
        raise ValueError(f"flows must share a grid, got {tuple(backward.shape)} and {tuple(forward.shape)}")
    height, width = backward.shape[2:]
    size = backward.new_tensor([width, height])
    centres = create_meshgrid(height, width, normalized_coordinates=False).to(backward) + 0.5
    place = (centres + backward.movedim(1, -1)) / size  # in the frame before, [0, 1]
    back = grid_sample(forward, 2 * place.nan_to_num() - 1, padding_mode="border", align_corners=False)
    missed = (backward + back).square().sum(1)
    allowed = SHARE * (backward.square().sum(1) + back.square().sum(1)) + SLACK
    outside = ((place < 0) | (place > 1)).any(-1)
    return torch.exp2(-missed / allowed).masked_fill(outside, 0.0)
