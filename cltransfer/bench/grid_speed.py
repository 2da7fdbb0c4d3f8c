"""How fast voxel grids render, and how exactly: kernels and the torch oracle in turn, on one machine."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch

from ..renderers.nerf_grid import NerfGridRenderer
from ..scenes.nerf_grid import NerfGrid
from .synthetic_room import ROOM, synthetic_room
from .timing import SIZES, Posed, SpeedBench, SpeedRow, at_size, one_and_two_threads, room

THICKNESS = 3.0  # optical, of a voxel that holds a surface


def _filled(posed: Posed) -> tuple[float]:
    """Share of the vertices that hold matter."""
    grid: Any = posed[0].geometry
    return (len(grid) / grid.density.numel(),)


BENCH = SpeedBench(
    name="grid",
    told=[
        "Wall time, four cameras a call, quartiles over",
        "seeds and repeats, half a voxel a step; torch (which skips nothing) and kernels in turn on one thread each",
        "where they are compared.",
    ],
    renderer=NerfGridRenderer,
    counts=_filled,
    columns={"filled": "{:.1%}"},
    buffer="image",
    accuracy=lambda one, other: float((one - other).abs().mean()),
    worst=max,
    compared=("mean RGB difference", "{:.0e}"),
    settings=one_and_two_threads(NerfGridRenderer.provides),
)


def run_grid_speed(seeds: Sequence[int], quick: bool = False) -> list[SpeedRow]:
    """Time the kernels against the oracle, and over sizes.

    Args:
        seeds: of the synthetic rooms; times of all are pooled.
        quick: few repeats of small settings, to check that the bench works.

    Returns:
        Rows in the order of the table. Torch and kernels run on one thread where they are compared.
    """
    repeats = 2 if quick else 9
    rows: list[SpeedRow] = []
    for side, degree in ((32, 0),) if quick else ((128, 0), (128, 2)):
        name = f"room {side}^3, degree {degree}"
        rooms = [room(room_grid(side, degree, seed), name, seed) for seed in seeds]
        rows += BENCH.against_oracle(rooms, max(2, repeats // 3))
        for size in SIZES[:1] if quick else SIZES[:2]:
            rows += BENCH.each_setting(at_size(rooms, size), repeats)
    return rows


def room_grid(side: int, degree: int, seed: int) -> NerfGrid:
    """The synthetic room as a cube of ``side``^3 vertices; each holds matter where a Gaussian's centre is nearest."""
    splats = synthetic_room(20 * side**2, seed, degree)
    middle, half = torch.from_numpy(ROOM / 2), float(ROOM.max()) * 0.51
    aabb = torch.stack([middle - half, middle + half])
    voxel = 2 * half / (side - 1)
    solid = splats.opacity > 0.3
    x, y, z = ((splats.means[solid].double() - aabb[0]) / voxel).round().long().T
    density, label = torch.zeros(side, side, side), torch.zeros(side, side, side)
    sh = torch.zeros(side, side, side, (degree + 1) ** 2, 3)
    density[z, y, x], label[z, y, x], sh[z, y, x] = THICKNESS / voxel, splats.label[solid], splats.sh[solid]
    return NerfGrid(density, sh, label, aabb)
