"""What the camera does, as rates of eight primitives that clips and camera paths share."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

PRIMITIVES = ("pan", "tilt", "roll", "zoom", "dolly", "truck", "boom", "orbit")

# what one unit of each moves on average over a frame [frame sides]: a roll or a growth, by the distance from its middle
APPARENT = (1.0, 1.0, 0.4, 0.4, 0.4, 1.0, 1.0, 1.0)


def frame_side(size: tuple[int, int]) -> float:
    """Side of a square as large as a frame of ``size`` (W, H): a unit for upright and for wide frames."""
    return math.sqrt(size[0] * size[1])


@dataclass(frozen=True)
class Motion:
    """What the camera did since the frame before, in N frames.

    Args:
        rates: of :data:`PRIMITIVES`, (N, 8): pan right, tilt up [frame sides of apparent motion], roll clockwise
            [rad], zoom in, dolly in [log size], truck right, boom up, orbit to the camera's right [frame sides of
            apparent motion]. The first frame is 0; a frame whose motion could not be read is NaN.
        times: (N,) [s].
        parallax: part of the background's motion that no turning and no zooming explains, in [0, 1]; NaN where
            nothing moves, or where it was not needed because the cameras are known.
    """

    rates: Tensor  # (N, 8)
    times: Tensor  # (N,) [s]
    parallax: float

    def __post_init__(self) -> None:
        if self.rates.shape != (len(self.times), len(PRIMITIVES)):
            raise ValueError(f"rates must be ({len(self.times)}, {len(PRIMITIVES)}), got {tuple(self.rates.shape)}")

    @property
    def track(self) -> Tensor:
        """Apparent motion since the first frame, (N, 8) [frame sides]; frames that were not read add nothing."""
        return (self.rates.nan_to_num(0) * self.rates.new_tensor(APPARENT)).cumsum(0)

    @property
    def read(self) -> int:
        """Frames whose motion was read, the first included."""
        return int(torch.isfinite(self.rates).all(1).sum())
