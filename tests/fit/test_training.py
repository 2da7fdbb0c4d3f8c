"""A level is trained by one process, wherever it runs, from the pixels that count."""

from __future__ import annotations

import re
import signal
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.errors import ResourceError
from cltransfer.fit._training import GridModule
from cltransfer.fit._views import Views
from cltransfer.fit.nerf_grid import NerfGridFit, empty_grid, filled_cells

OPTIONS = NerfGridFit(first=200, most=200, steps=9, look=3, rays=64, degree=0)


class Stop(Exception):
    """What interrupts a fit."""


@pytest.mark.parametrize("tasks", ["1", "4"])
def test_a_job_of_slurm_trains_alone_and_puts_itself_in_no_queue(
    views: Views, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tasks: str
) -> None:
    handlers: set[object] = set()

    def look(step: str, done: int, total: int) -> None:
        handlers.add(signal.getsignal(signal.SIGUSR1))
        if done == 5:
            raise Stop

    job = {"JOB_ID": "1", "JOB_NAME": "fit", "NTASKS": tasks, "PROCID": "3", "LOCALID": "3", "NODEID": "0"}
    for name, value in job.items():
        monkeypatch.setenv(f"SLURM_{name}", value)
    before = signal.getsignal(signal.SIGUSR1)
    with pytest.raises(Stop):
        OPTIONS.fit(views, tmp_path, look)
    assert handlers == {before}
    assert (tmp_path / "level_0.safetensors").is_file()
    (level,) = OPTIONS.fit(views, tmp_path, lambda *step: None)
    assert level.steps == 9


def test_nothing_is_learnt_from_pixels_that_do_not_count(views: Views, tmp_path: Path) -> None:
    counted = torch.ones(25, 48, 48, dtype=torch.bool)
    counted[:, 20:30] = False
    grids = []
    for shade in (0, 255):
        image = views.image.clone()
        image[:, :, 20:30] = shade
        masked = replace(views, image=image, counted=counted)
        OPTIONS.fit(masked, tmp_path / str(shade), lambda *step: None)
        grids.append((tmp_path / str(shade) / "grid.safetensors").read_bytes())
    assert grids[0] == grids[1]
    OPTIONS.fit(replace(masked, counted=None), tmp_path / "all", lambda *step: None)
    assert (tmp_path / "all" / "grid.safetensors").read_bytes() != grids[0]


def test_masks_are_held_against_the_memory(views: Views, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CLTRANSFER_MEMORY", "1")
    side, needs = 400, []
    large = replace(
        views,
        camera=views.camera.at_size((side, side)),
        image=torch.zeros((), dtype=torch.uint8).expand(25, 3, side, side),
    )
    for counted in (None, torch.ones((), dtype=torch.bool).expand(25, side, side)):
        with pytest.raises(ResourceError, match="the rays of 25 images need") as refused:
            OPTIONS.fit(replace(large, counted=counted), tmp_path, lambda *step: None)
        needs += [int(number) for number in re.findall(r"need (\d+) MB", str(refused.value))]
    assert needs[1] - needs[0] == pytest.approx(25 * side**2 / 2**20, abs=1)


def module(kind: type[GridModule] = GridModule) -> GridModule:
    """A level of thin fog, before three small views of noise."""
    eye = torch.tensor([[0.0, -3, 0]] * 3)
    cameras = Camera.look_at(eye, torch.zeros(1, 3), torch.tensor([0.0, 0, 1]), 0.7, (8, 8))
    image = torch.randint(0, 255, (3, 3, 8, 8), dtype=torch.uint8, generator=torch.Generator().manual_seed(0))
    views = Views(cameras, image, torch.tensor([[-1.0] * 3, [1.0] * 3], dtype=torch.float64))
    grid = empty_grid((3, 3, 3), 0, views.aabb)
    return kind(grid, filled_cells(grid), (views, views), NerfGridFit(rays=4, degree=0, steps=30, look=10))


def test_later_looks_draw_other_rays() -> None:
    def loss(step: int) -> float:
        class At(GridModule):
            global_step = step  # type: ignore[assignment]

        return float(module(At).training_step(torch.tensor(0), 0).detach())

    assert loss(0) != loss(100)


def test_a_step_below_nothing_ends_at_nothing() -> None:
    level = module()
    with torch.no_grad():
        level.thickness[0] = -0.5
    level.on_train_batch_end(None, None, 0)
    assert float(level.thickness.detach().min()) == 0


def test_the_rate_falls_to_a_tenth_over_a_level() -> None:
    level = module()
    fall = level.configure_optimizers()["lr_scheduler"]["scheduler"]
    assert fall.gamma**level.options.steps == pytest.approx(0.1)
