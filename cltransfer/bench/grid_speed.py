"""How fast voxel grids render, and how exactly: kernels and the torch oracle in turn, on one machine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch

from ..renderers.nerf_grid import NerfGridRenderer
from ..scenes import Scene
from ..scenes.nerf_grid import NerfGrid
from .section import quartiles
from .synthetic_room import ROOM, room_cameras, synthetic_room
from .timing import FRAMES, GEOMETRY, Posed, call_time, size_cell, speedup_cell, time_cell, timed_in_turn, write_rows

ALL = NerfGridRenderer.provides
SIZES = ((160, 90), (320, 180))
THICKNESS = 3.0  # optical, of a voxel that holds a surface


@dataclass(frozen=True)
class GridRow:
    """One setting, timed.

    Args:
        scene: what was rendered.
        size: (W, H) [px].
        setting: backend and buffers.
        threads: that worked at once.
        filled: share of the vertices that hold matter.
        milliseconds: wall time a frame: lower quartile, median, upper quartile.
        speedup: median of the torch oracle over this median, where both were timed in turn.
        difference: of the image from the oracle's, mean absolute, the greatest over the seeds.
    """

    scene: str
    size: tuple[int, int]
    setting: str
    threads: int
    filled: float
    milliseconds: tuple[float, float, float]
    speedup: float | None = None
    difference: float | None = None

    HEADER = "scene | size | setting | threads | filled | ms a frame (quartiles) | against torch | mean RGB difference"

    def cells(self) -> list[str]:
        """What a table shows, in the order of ``HEADER``."""
        counts = [str(self.threads), f"{self.filled:.1%}"]
        timing, speedup = time_cell(self.milliseconds), speedup_cell(self.speedup)
        difference = "" if self.difference is None else f"{self.difference:.0e}"
        return [self.scene, size_cell(self.size), self.setting, *counts, timing, speedup, difference]

    def __str__(self) -> str:
        return " | ".join(self.cells())


def run_grid_speed(seeds: Sequence[int], quick: bool = False) -> list[GridRow]:
    """Time the kernels against the oracle, and over sizes.

    Args:
        seeds: of the synthetic rooms; times of all are pooled.
        quick: few repeats of small settings, to check that the bench works.

    Returns:
        Rows in the order of the table. Torch and kernels run on one thread where they are compared.
    """
    repeats = 2 if quick else 9
    rows: list[GridRow] = []
    for side, degree in ((32, 0),) if quick else ((128, 0), (128, 2)):
        rooms = [_room(side, degree, seed) for seed in seeds]
        rows += _against_oracle(rooms, max(2, repeats // 3))
        rows += _over_sizes(rooms, SIZES[:1] if quick else SIZES, repeats)
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


def _room(side: int, degree: int, seed: int) -> Posed:
    name = f"room {side}^3, degree {degree}"
    scene = Scene(room_grid(side, degree, seed), None, torch.tensor([0.0, 0.0, 1.0]), name, f"{name}:{seed}")
    return scene, room_cameras(FRAMES, SIZES[0], seed)


def _against_oracle(posed: list[Posed], repeats: int) -> list[GridRow]:
    """Kernels and oracle in turn on one thread each, and how far their images are apart."""
    kernels, oracle = NerfGridRenderer(threads=1), NerfGridRenderer(backend="torch")
    found = timed_in_turn(
        kernels, oracle, posed, repeats, "image", lambda one, other: float((one - other).abs().mean())
    )
    row = replace(_row(posed[0], "numba, all", 1, found.kernels), speedup=found.speedup, difference=max(found.apart))
    return [_row(posed[0], "torch, all", 1, found.oracle), row]


def _over_sizes(posed: list[Posed], sizes: Sequence[tuple[int, int]], repeats: int) -> list[GridRow]:
    """Kernels at each size: all buffers and geometry alone on one thread, and all buffers on two."""
    rows = []
    for size in sizes:
        resized = [(scene, cameras.at_size(size)) for scene, cameras in posed]
        for setting, buffers, threads in (("all", ALL, 1), ("depth + label", GEOMETRY, 1), ("all", ALL, 2)):
            renderer = NerfGridRenderer(threads=threads)
            times = [call_time(renderer, pair, buffers) for pair in resized for _ in range(repeats)]
            rows.append(_row(resized[0], f"numba, {setting}", threads, times))
    return rows


def _row(posed: Posed, setting: str, threads: int, times: Sequence[float]) -> GridRow:
    scene, cameras = posed
    grid: Any = scene.geometry
    filled = len(grid) / grid.density.numel()
    return GridRow(scene.name, cameras.size, setting, threads, filled, quartiles(times))


def write_benchmarks(rows: Sequence[GridRow], path: Path, command: str) -> None:
    """Put the rows into the Markdown file ``path``, in the section of voxel grids."""
    told = [
        f"Made by `{command}`. Wall time, four cameras a call, quartiles over",
        "seeds and repeats, half a voxel a step; torch (which skips nothing) and kernels in turn on one thread each",
        "where they are compared.",
    ]
    write_rows(rows, path, "grid", told)
