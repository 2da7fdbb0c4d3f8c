"""Gradient descent on a voxel grid by Lightning's Trainer. Imported only where something is fitted."""

from __future__ import annotations

import contextlib
import logging
import signal
import threading
import time
import traceback
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytorch_lightning as pl
import torch
from pytorch_lightning.callbacks import Callback, EarlyStopping, ModelCheckpoint
from pytorch_lightning.plugins.environments import LightningEnvironment
from pytorch_lightning.utilities.exceptions import SIGTERMException
from torch import Tensor
from torch.utils.data import DataLoader

from ..errors import InputError
from ..progress import Progress
from ..renderers._nerf_grid_torch import Rays, camera_rays
from ..scenes.nerf_grid import NerfGrid
from ._checkpoint import ANEW, StateFiles
from ._rays import colors, distance_to_cells
from ._views import Views, psnr

if TYPE_CHECKING:
    from .nerf_grid import NerfGridFit

OWN = ("training_step", "validation_step", "on_train_batch_end")  # what fails in these is no fault of a checkpoint
STILL = 1e-6  # slope of the loss below which Adam makes no full step: noise would fill empty space with fog


class GridModule(pl.LightningModule):
    """One level of a grid: rays drawn from the training views, PSNR on the held-out ones.

    Args:
        grid: where to start.
        filled: cells (Z - 1, Y - 1, X - 1) that may hold matter.
        views: to learn from, and to score on.
        options: of the fit.
    """

    def __init__(self, grid: NerfGrid, filled: Tensor, views: tuple[Views, Views], options: NerfGridFit) -> None:
        super().__init__()
        self.options, self.voxel = options, float(grid.voxel.min())
        self.thickness = torch.nn.Parameter(grid.density * self.voxel)  # optical thickness of a voxel
        self.sh = torch.nn.Parameter(grid.sh.clone())
        self.aabb, self.filled, self.bricks = grid.aabb, filled, distance_to_cells(filled)
        self.learn, self.held_out = views
        rays = camera_rays(self.learn.camera)
        self.rays = Rays(rays.origin.float(), rays.direction.float())
        self.colors = self.learn.image.permute(0, 2, 3, 1).reshape(-1, 3)
        self.counted = None if self.learn.counted is None else self.learn.counted.flatten().nonzero()[:, 0]

    def grid(self) -> NerfGrid:
        """The field as it is now; gradients flow to the parameters."""
        return NerfGrid(self.thickness / self.voxel, self.sh, torch.zeros_like(self.thickness), self.aabb)

    def on_train_start(self) -> None:
        """Lightning takes up the looks without gain from a checkpoint, and not that they had ended the level."""
        stop = self.trainer.early_stopping_callback
        if stop is not None and stop.wait_count >= stop.patience:
            self.trainer.should_stop = True

    def training_step(self, batch: Tensor, batch_idx: int) -> Tensor:
        """Mean squared colour error of random pixels; what is drawn depends on the seed and the step alone."""
        random = torch.Generator().manual_seed((self.options.seed * 1_000_003 + self.global_step) % 2**63)
        count = len(self.colors if self.counted is None else self.counted)
        pixel = torch.randint(count, (self.options.rays,), generator=random)
        pixel = pixel if self.counted is None else self.counted[pixel]
        rays = Rays(self.rays.origin[pixel], self.rays.direction[pixel])
        drawn = colors(self.grid(), rays, self.options.renderer.settings, self.filled, self.bricks)
        error = ((drawn - self.colors[pixel] / 255) ** 2).mean()
        rough = roughness(self.thickness[..., None]) + roughness(self.sh.flatten(3))
        return error + self.options.smooth * rough + self.options.sparse * self.thickness.mean()

    def on_train_batch_end(self, outputs: Any, batch: Any, batch_idx: int) -> None:
        """Density is never negative: a step that would make it so ends at 0, and may leave it again."""
        with torch.no_grad():
            self.thickness.clamp_(min=0)

    def validation_step(self, batch: Tensor, batch_idx: int) -> None:
        """PSNR of all held-out views, mean."""
        self.log("psnr", psnr(self.grid(), self.held_out, self.options.renderer), batch_size=1)

    def configure_optimizers(self) -> Any:
        """Adam whose rate falls to a tenth over the level."""
        adam = torch.optim.Adam(self.parameters(), lr=self.options.rate, eps=STILL, fused=True)
        fall = torch.optim.lr_scheduler.ExponentialLR(adam, 0.1 ** (1 / self.options.steps))
        return {"optimizer": adam, "lr_scheduler": {"scheduler": fall, "interval": "step"}}

    def train_dataloader(self) -> Any:
        """Numbers of the steps between two looks at the held-out views; rays are drawn in the step."""
        return _numbers(self.options.look)

    def val_dataloader(self) -> Any:
        """One batch: all held-out views."""
        return _numbers(1)


def _numbers(count: int) -> Any:
    """Numbers 0 to ``count``; a loader without a generator of its own draws from the caller's."""
    return DataLoader(range(count), batch_size=None, generator=torch.Generator())  # type: ignore[arg-type]


class Teller(Callback):
    """Tells the caller's progress."""

    def __init__(self, progress: Progress, name: str, total: int) -> None:
        self.progress, self.name, self.total = progress, name, total

    def on_train_batch_end(self, trainer: pl.Trainer, *_: Any) -> None:
        """After each step."""
        self.progress(self.name, trainer.global_step, self.total)


class Clock(Callback):
    """Seconds since it was made, and those that a checkpoint tells of: a level's, however often it was interrupted."""

    def __init__(self) -> None:
        self.since = time.perf_counter()

    @property
    def seconds(self) -> float:
        """Until now."""
        return time.perf_counter() - self.since

    def state_dict(self) -> dict[str, Any]:
        """What a checkpoint keeps."""
        return {"seconds": self.seconds}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Count on from a checkpoint."""
        self.since -= state_dict["seconds"]


def roughness(values: Tensor) -> Tensor:
    """Mean squared difference of neighbours of (Z, Y, X, C), summed over the axes and channels."""
    return sum((values.diff(dim=axis) ** 2).mean((0, 1, 2)).sum() for axis in range(3))  # type: ignore[return-value]


def train(module: GridModule, checkpoint: Path, progress: Progress) -> tuple[int, float]:
    """Train ``module`` until its held-out PSNR stands still or its steps are done; return the steps and their seconds.

    ``checkpoint``, a name that ends in .safetensors, is resumed where it exists, and rewritten at every look.

    Raises:
        InputError: ``checkpoint`` is damaged, or of something else.
    """
    options, clock = module.options, Clock()
    keep = ModelCheckpoint(
        checkpoint.parent, checkpoint.stem, save_top_k=1, save_on_train_epoch_end=True, enable_version_counter=False
    )
    keep.FILE_EXTENSION = checkpoint.suffix
    stop = EarlyStopping("psnr", options.gain, options.patience, mode="max", check_on_train_epoch_end=False)
    files = StateFiles({name: tuple(value.shape) for name, value in module.named_parameters()})
    with _quiet():
        trainer = pl.Trainer(
            accelerator="cpu",
            max_steps=options.steps,
            callbacks=[Teller(progress, checkpoint.stem, options.steps), clock, stop, keep],
            plugins=[files, LightningEnvironment()],  # under SLURM too: one process, which puts itself in no queue
            default_root_dir=checkpoint.parent,
            num_sanity_val_steps=0,
            logger=False,
            enable_progress_bar=False,
            enable_model_summary=False,
        )
        with _signals(), _going_on(checkpoint):
            trainer.fit(module, ckpt_path=str(checkpoint) if checkpoint.is_file() else None)
    return int(trainer.global_step), clock.seconds


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Without Lightning's advice: results go to stdout, progress is told by the caller."""
    loggers = [logging.getLogger(name) for name in ("pytorch_lightning", "lightning_fabric")]
    levels = [logger.level for logger in loggers]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for logger in loggers:
            logger.setLevel(logging.ERROR)
        try:
            yield
        finally:
            for logger, level in zip(loggers, levels):
                logger.setLevel(level)


@contextlib.contextmanager
def _signals() -> Iterator[None]:
    """An interrupt stays one: Lightning turns it into exit code 1, and SIGTERM into 0.

    Only the main thread has handlers that it can change, and only those of Python can be put back.
    """
    before = signal.getsignal(signal.SIGINT)
    try:
        yield
    except SIGTERMException:
        raise SystemExit(143) from None
    except SystemExit:
        raise KeyboardInterrupt from None
    finally:
        if before is not None and threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, before)


@contextlib.contextmanager
def _going_on(checkpoint: Path) -> Iterator[None]:
    """What Lightning or Adam raises of a part of ``checkpoint`` that only they know, told in one line with the file."""
    resumed = checkpoint.is_file()
    try:
        yield
    except (TypeError, ValueError, LookupError, AttributeError, RuntimeError) as error:
        frames = traceback.extract_tb(error.__traceback__)
        if not resumed or any(frame.filename == __file__ and frame.name in OWN for frame in frames):
            raise
        reason = f"cannot be gone on from: {type(error).__name__}: {' '.join(str(error).split())}"
        raise InputError(checkpoint, "", reason, ANEW) from error
