"""Voxel grids from posed images, coarse to fine: cells are added only while held-out images gain by it."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from torch import Tensor
from torch.nn.functional import interpolate, max_pool3d

from ..computer.memory import require_free
from ..errors import InputError
from ..progress import Progress
from ..registry import FITTERS
from ..renderers.nerf_grid import NerfGridRenderer
from ..scenes.nerf_grid import NerfGrid, read_grid, write_grid
from ._curve import Level, write_curve
from ._folder import begun, write_state
from ._views import Views, psnr

GRID = "grid.safetensors"
START = 0.01  # optical thickness of a voxel before anything is known
FAINT = 0.02  # optical thickness of a voxel below which it is taken for empty
AUTO = "auto"
ANOTHER = ", in another folder"  # where levels are done, which a fit with other options does not go on from


@FITTERS.register("nerf_grid")
@dataclass(frozen=True)
class NerfGridFit:
    """Fits a :class:`~cltransfer.scenes.nerf_grid.NerfGrid`.

    Args:
        budget: cells; ``auto`` adds them while the held-out PSNR rises by ``gain``, up to ``most``.
        first: cells of the first level.
        growth: cells of a level over those of the level before, > 1.
        most: cells, with ``auto``.
        degree: of the spherical harmonics, 0..2.
        side: of the images, the longer one at most [px].
        hold_out: every so many-th view is scored on and not learnt from, >= 2.
        gain: held-out PSNR [dB] that a level, or ``patience`` looks within one, must add.
        steps: at most in a level.
        look: steps between looks at the held-out views.
        patience: looks without gain that end a level.
        rays: in a step.
        rate: of Adam.
        smooth: weight of the squared differences between neighbours.
        sparse: weight of the mean optical thickness, so that no fog stays where nothing is seen to be.
        step: longest step of a ray as a fraction of a voxel edge, in (0, 1].
        near: nothing nearer to a camera is learnt, scene units, > 0.
        seed: of the rays that are drawn.

    Raises:
        ValueError: an option is out of range.
    """

    budget: int | str = AUTO
    first: int = 16_000
    growth: float = 4.0
    most: int = 2_000_000
    degree: int = 1
    side: int = 200
    hold_out: int = 8
    gain: float = 0.1
    steps: int = 1000
    look: int = 100
    patience: int = 2
    rays: int = 2048
    rate: float = 0.05
    smooth: float = 3e-3
    sparse: float = 3e-3
    step: float = 0.5
    near: float = 0.1
    seed: int = 0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, float) and not math.isfinite(value):
                raise ValueError(f"{name} must be finite, got {value}")
        if self.budget != AUTO and not (isinstance(self.budget, int) and self.budget >= 8):
            raise ValueError(f"budget must be {AUTO} or at least 8 cells, got {self.budget!r}")
        if self.degree not in (0, 1, 2):
            raise ValueError(f"degree must be 0, 1 or 2, got {self.degree}")
        if not self.growth > 1:
            raise ValueError(f"growth must be greater than 1, got {self.growth}")
        least_of = {"first": 8, "most": 8, "side": 1, "hold_out": 2, "steps": 1, "look": 1, "patience": 1, "rays": 1}
        for name, least in least_of.items():
            if getattr(self, name) < least:
                raise ValueError(f"{name} must be at least {least}, got {getattr(self, name)}")
        for name in ("gain", "smooth", "sparse"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")
        if not self.rate > 0:
            raise ValueError(f"rate must be positive, got {self.rate}")
        _ = self.renderer  # checks step and near

    @property
    def renderer(self) -> NerfGridRenderer:
        """What held-out views are scored with."""
        return NerfGridRenderer(step=self.step, near=self.near)

    def require(self) -> None:
        """Nothing: it runs on any computer."""

    def fit(self, views: Views, folder: Path, progress: Progress) -> list[Level]:
        """Fit a grid into ``folder``: grid.safetensors, fit.json, curve.csv and curve.svg; an unfinished fit goes on.

        Raises:
            UsageError: the folder holds a fit with other options or views, or something else.
            ResourceError: a level needs more memory than is free.
        """
        views.check_near(self.near)
        key = {"as": "nerf_grid", "options": asdict(self), "views": views.digest}
        levels = begun(folder, key, GRID)
        for number in range(len(levels)):
            _checkpoint(folder, number).unlink(missing_ok=True)  # where a fit was killed just before it
        for cells in self._sizes()[len(levels) :]:
            if levels and not levels[-1].kept:
                break
            self._check_memory(len(levels), cells, views, folder)
            if not levels:
                write_state(folder, key, [])
            level, grid = self._level(len(levels), cells, views, folder, progress)
            gained = not levels or self.budget != AUTO or level.psnr >= levels[-1].psnr + self.gain
            levels.append(Level(**{**asdict(level), "kept": gained}))
            write_curve(folder, levels, "cells")
            if gained:
                write_grid(folder / GRID, grid)
            write_state(folder, key, levels)  # last: by it a level is done
            _checkpoint(folder, len(levels) - 1).unlink(missing_ok=True)
        return levels

    def _sizes(self) -> list[int]:
        """Cells of each level; the last is the budget."""
        last = self.most if self.budget == AUTO else int(self.budget)
        sizes = [min(self.first, last)]
        while sizes[-1] < last:
            sizes.append(min(max(sizes[-1] + 1, round(sizes[-1] * self.growth)), last))
        return sizes

    def _check_memory(self, number: int, cells: int, views: Views, folder: Path) -> None:
        need = bytes_needed(cells, self.degree, views.image.numel() // 3, views.counted is not None)
        what = f"{cells} cells and the rays of {len(views)} images"
        require_free(need, folder, what, "take a smaller budget or side" + ANOTHER * (number > 0))

    def _level(self, number: int, cells: int, views: Views, folder: Path, progress: Progress) -> tuple[Level, NerfGrid]:
        """Train one level, from the grid of the one before where there is one."""
        from ._training import GridModule, train

        shape = grid_shape(views.aabb, cells)
        coarse = read_grid(folder / GRID) if number else None
        start = resampled(coarse, shape) if coarse else empty_grid(shape, self.degree, views.aabb)
        learn, held_out = views.split(self.hold_out)
        module = GridModule(start, filled_cells(start), (learn, held_out), self)
        steps, seconds = train(module, _checkpoint(folder, number), progress)
        grid = without_faint(module.grid())
        score = psnr(grid, held_out, self.renderer)
        filled = int(filled_cells(grid).sum())
        if not filled:
            if not number:
                _checkpoint(folder, number).unlink(missing_ok=True)  # other options may have the folder
            reason = f"nothing was learnt in {steps} steps: none of {filled_cells(grid).numel()} cells holds anything"
            hint = f"a smaller sparse= or near={ANOTHER * (number > 0)}; do poses fit?"
            raise InputError(folder, GRID, reason, hint)
        return Level(filled_cells(grid).numel(), filled, score, steps, seconds, True), grid


def _checkpoint(folder: Path, number: int) -> Path:
    return folder / f"level_{number}.safetensors"


def bytes_needed(cells: int, degree: int, pixels: int, masked: bool) -> int:
    """What training a grid takes at its peak: values, gradients and moments of ``cells``, rays of ``pixels``.

    Measured: 79 bytes a pixel, 1 more where some are ``masked``; 292, 630 and 1296 a cell of degree 0, 1 and 2.
    """
    return (80 + masked) * pixels + cells * (100 + 48 * (1 + 3 * (degree + 1) ** 2))


def grid_shape(aabb: Tensor, cells: int) -> tuple[int, int, int]:
    """Vertices Z, Y, X of about ``cells`` nearly cubic cells in the box (2, 3)."""
    extent = aabb[1] - aabb[0]
    edge = (extent.prod() / cells) ** (1 / 3)
    x, y, z = (max(1, round(float(length / edge))) + 1 for length in extent)
    return z, y, x


def empty_grid(shape: tuple[int, int, int], degree: int, aabb: Tensor) -> NerfGrid:
    """Thin grey fog."""
    grid = NerfGrid(torch.ones(shape), torch.zeros(*shape, (degree + 1) ** 2, 3), torch.zeros(shape), aabb)
    return NerfGrid(grid.density * START / float(grid.voxel.min()), grid.sh, grid.label, aabb)


def resampled(grid: NerfGrid, shape: tuple[int, int, int]) -> NerfGrid:
    """The same field on a grid of ``shape`` (Z, Y, X)."""

    def resize(values: Tensor) -> Tensor:  # (Z, Y, X, C)
        moved = values.permute(3, 0, 1, 2)[None]
        return interpolate(moved, shape, mode="trilinear", align_corners=True)[0].permute(1, 2, 3, 0).contiguous()

    density, label = (resize(values[..., None])[..., 0] for values in (grid.density, grid.label))
    return NerfGrid(density, resize(grid.sh.flatten(3)).unflatten(3, (-1, 3)), label, grid.aabb)


def without_faint(grid: NerfGrid) -> NerfGrid:
    """The grid without voxels whose optical thickness is below ``FAINT``; detached."""
    density = grid.density.detach()
    keep = density * float(grid.voxel.min()) >= FAINT
    return NerfGrid(density * keep, grid.sh.detach(), grid.label.detach(), grid.aabb)


def filled_cells(grid: NerfGrid) -> Tensor:
    """Cells (Z - 1, Y - 1, X - 1) that hold matter, or whose neighbours do."""
    around = max_pool3d((grid.density > 0)[None].float(), 4, stride=1, padding=1)  # vertices of a cell and one beyond
    return around[0] > 0
