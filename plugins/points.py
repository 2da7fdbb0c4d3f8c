"""An example renderer of scenes that are there already: the Gaussians of a splat scene as points.

It is no look that one would keep; it shows what a renderer is: cameras in, the buffers that are asked for out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor
from torch.nn.functional import pad

from cltransfer import RENDERERS, Camera, Features, Scene
from cltransfer.scenes.splats import Splats

SH_0 = 0.28209479177387814  # of the colour less 0.5, what looks the same from all sides


def nearest(pixels: Tensor, depth: Tensor, size: tuple[int, int], side: int) -> Tensor:
    """Which of N points each pixel shows, (H, W) int64; N where none is.

    Args:
        pixels: of the points, (N, 2) [px].
        depth: of the points, (N,), larger is farther.
        size: (W, H) [px].
        side: of the square that each point fills, odd [px].
    """
    (width, height), count = size, len(depth)
    order = depth.argsort()
    reach = torch.arange(side) - side // 2
    places = pixels[order].floor().long()[:, None] + torch.cartesian_prod(reach, reach)  # (N, side^2, 2)
    x, y = places.unbind(-1)
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    rank = torch.arange(count)[:, None].expand_as(x)  # of two in one pixel the lower is nearer
    first = torch.full((height * width,), count).scatter_reduce(0, (y * width + x)[inside], rank[inside], "amin")
    return pad(order, (0, 1), value=count)[first].reshape(height, width)


@RENDERERS.register("points")
@dataclass(frozen=True)
class Points:
    """Draws every Gaussian as a square about its centre, over black, all of one size; the nearest hides the others.

    Args:
        side: of the squares [px], odd; larger ones leave fewer holes, and have the depth of their centre throughout.
        least: opacity below which a Gaussian is not drawn, in [0, 1]: haze would hide what is behind it.
        near: nothing nearer is drawn, scene units, > 0.
    """

    side: int = 1
    least: float = 0.3
    near: float = 0.1

    provides: ClassVar[frozenset[str]] = frozenset({"image", "alpha", "label", "depth", "expected_depth"})
    draws: ClassVar[tuple[str, ...]] = ("gaussian_splats",)  # the scenes of that renderer; it is given no others

    def __post_init__(self) -> None:
        if self.side < 1 or self.side % 2 == 0:
            raise ValueError(f"side must be odd, got {self.side}")
        if not 0 <= self.least <= 1:
            raise ValueError(f"least must be in [0, 1], got {self.least}")
        if not self.near > 0:
            raise ValueError(f"near must be positive, got {self.near}")

    def render(self, scene: Scene, cameras: Camera, buffers: frozenset[str]) -> Features:
        """What B cameras see; depth is along the optical axis, NaN where there is nothing."""
        frames = [self._frame(scene.geometry, cameras[i]) for i in range(len(cameras))]  # 9 ms each at 160x90
        drawn: dict[str, Any] = {name: torch.stack([frame[name] for frame in frames]) for name in buffers}
        return Features(cameras.size, **drawn, camera=cameras, person=scene.subject)

    def _frame(self, splats: Splats, camera: Camera) -> dict[str, Tensor]:
        """Every buffer of one camera; a pixel without a point shows a last one that is nothing."""
        pixels, depth = (of_one[0].float() for of_one in camera.project(splats.means))
        there = (depth > self.near) & (splats.opacity >= self.least)
        colors = (0.5 + SH_0 * splats.sh[there, 0]).clamp(0, 1)
        which = nearest(pixels[there], depth[there], camera.size, self.side)
        along = pad(depth[there], (0, 1), value=torch.nan)[which]
        return {
            "image": pad(colors, (0, 0, 0, 1))[which].movedim(-1, 0),
            "alpha": along.isfinite().float(),
            "label": pad(splats.label[there], (0, 1))[which],
            "depth": along,
            "expected_depth": along,
        }
