from __future__ import annotations

import csv
import json
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from itertools import pairwise

import pytest
import torch

from cltransfer.errors import InputError, ResourceError, UsageError
from cltransfer.fit.nerf_grid import (
    NerfGridFit,
    empty_grid,
    filled_cells,
    grid_shape,
    resampled,
    without_faint,
)
from cltransfer.registry import FITTERS
from cltransfer.renderers.nerf_grid import NerfGridRenderer
from cltransfer.scenes import Scene
from cltransfer.scenes.nerf_grid import NerfGrid, read_grid

BOX = torch.tensor([[-1.1, -1.1, -0.9], [1.1, 1.1, 0.8]], dtype=torch.float64)
QUICK = NerfGridFit(first=2000, most=2000, steps=60, look=20, rays=256, degree=0)


def silent(step: str, done: int, total: int) -> None:
    """Nobody listens."""


@pytest.fixture(scope="module")
def fitted(views, tmp_path_factory):
    """A fit in full, about three seconds on one core."""
    folder = tmp_path_factory.mktemp("fit")
    told: list[tuple[str, int, int]] = []
    options = NerfGridFit(first=8000, most=64_000, steps=160, rays=768, degree=0)
    levels = options.fit(views, folder, lambda *step: told.append(step))
    return options, folder, levels, told


def test_an_analytic_scene_is_learnt_to_30_db_on_views_held_out(fitted):
    _, _, levels, _ = fitted
    assert max(level.psnr for level in levels if level.kept) >= 30


def test_a_fit_runs_beside_the_main_thread_too(views, tmp_path):
    with ThreadPoolExecutor(1) as pool:
        levels = pool.submit(QUICK.fit, views, tmp_path, silent).result()
    assert (tmp_path / "grid.safetensors").is_file()
    assert len(levels) == 1


def test_a_fit_that_leaves_nothing_is_refused(views, tmp_path):
    line = r"grid.safetensors: nothing was learnt in \d+ steps: none of \d+ cells holds anything \(a smaller sparse="
    with pytest.raises(InputError, match=line):
        replace(QUICK, sparse=1e3).fit(views, tmp_path, silent)
    assert not (tmp_path / "grid.safetensors").exists()


def test_cells_are_added_only_while_held_out_views_gain(fitted):
    options, _, levels, _ = fitted
    assert len(levels) >= 3
    assert [level.cells for level in levels] == sorted(level.cells for level in levels)
    for before, after in pairwise(levels):
        assert before.kept
        assert after.kept == (after.psnr >= before.psnr + options.gain)


def test_a_level_that_gains_less_than_asked_for_is_not_kept_and_the_last(views, tmp_path):
    options = NerfGridFit(first=500, most=64_000, steps=40, rays=256, degree=0, gain=3.0)
    levels = options.fit(views, tmp_path, silent)
    assert [level.kept for level in levels] == [True] * (len(levels) - 1) + [False]
    assert len(levels) == 3  # the next one would be of 64,000 cells or less, and is not begun
    assert filled_cells(read_grid(tmp_path / "grid.safetensors")).numel() == levels[1].cells


def test_the_grid_that_is_left_scores_what_the_last_kept_level_says(fitted, views):
    options, folder, levels, _ = fitted
    kept = [level for level in levels if level.kept][-1]
    grid = read_grid(folder / "grid.safetensors")
    held_out = views.split(options.hold_out)[1]
    scene = Scene(grid, None, torch.tensor([0.0, 0, 1]), "fit", "")
    drawn = NerfGridRenderer().render(scene, held_out.camera, frozenset({"image"})).image
    mse = ((drawn - held_out.image / 255) ** 2).flatten(1).mean(1)
    assert float((-10 * mse.log10()).mean()) == pytest.approx(kept.psnr, abs=1e-3)
    assert int(filled_cells(grid).sum()) == kept.filled < kept.cells


def test_the_folder_holds_curve_state_and_grid_and_no_leftovers(fitted):
    _, folder, levels, told = fitted
    assert sorted(p.name for p in folder.iterdir()) == ["curve.csv", "curve.svg", "fit.json", "grid.safetensors"]
    with (folder / "curve.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [int(row["cells"]) for row in rows] == [level.cells for level in levels]
    assert [float(row["psnr"]) for row in rows] == [level.psnr for level in levels]
    svg = (folder / "curve.svg").read_text()
    assert "held-out PSNR" in svg
    assert ">cells</text>" in svg
    assert f"{levels[0].psnr:.1f} dB" in svg
    assert told[0][0] == "level_0"
    assert {name for name, _, _ in told} == {f"level_{i}" for i in range(len(levels))}


def test_a_finished_fit_is_not_repeated(fitted, views):
    options, folder, levels, _ = fitted
    told: list[object] = []
    before = (folder / "grid.safetensors").stat().st_mtime_ns
    assert options.fit(views, folder, lambda *step: told.append(step)) == levels
    assert told == []
    assert (folder / "grid.safetensors").stat().st_mtime_ns == before


def test_a_finished_fit_whose_grid_is_gone_is_told(fitted, views, tmp_path):
    options, folder, _, _ = fitted
    (tmp_path / "fit.json").write_bytes((folder / "fit.json").read_bytes())
    with pytest.raises(InputError, match=r"grid\.safetensors: no such file, fit\.json has \d+ levels of it"):
        options.fit(views, tmp_path, silent)


def test_the_caller_s_random_numbers_are_left_alone_and_any_seed_is_taken(views, tmp_path):
    before = torch.get_rng_state()
    NerfGridFit(first=500, most=500, steps=3, look=3, rays=64, degree=0, seed=2**60).fit(views, tmp_path, silent)
    assert torch.equal(torch.get_rng_state(), before)


def test_other_options_or_views_are_not_mixed_into_a_folder(fitted, views):
    options, folder, _, _ = fitted
    for changed, seen in ((replace(options, rate=0.01), views), (options, views[range(20)])):
        with pytest.raises(UsageError, match="holds a fit with other options or views"):
            changed.fit(seen, folder, silent)


class Stop(Exception):
    """What interrupts a fit."""


def test_an_interrupted_level_goes_on_and_ends_where_it_would_have(views, tmp_path):
    def interrupt(step: str, done: int, total: int) -> None:
        if done == 45:
            raise Stop

    whole, parts = tmp_path / "whole", tmp_path / "parts"
    QUICK.fit(views, whole, silent)
    with pytest.raises(Stop):
        QUICK.fit(views, parts, interrupt)
    assert sorted(p.name for p in parts.iterdir()) == ["fit.json", "level_0.safetensors"]
    told: list[int] = []
    QUICK.fit(views, parts, lambda step, done, total: told.append(done))
    assert told[0] == 41  # the last look was after step 40
    first, second = (read_grid(folder / "grid.safetensors") for folder in (whole, parts))
    torch.testing.assert_close(first.density, second.density)
    torch.testing.assert_close(first.sh, second.sh)


def test_seconds_of_a_level_are_those_of_all_its_sessions(views, tmp_path):
    def interrupt(step: str, done: int, total: int) -> None:
        time.sleep(0.02)
        if done == 45:
            raise Stop

    with pytest.raises(Stop):
        QUICK.fit(views, tmp_path, interrupt)
    (level,) = QUICK.fit(views, tmp_path, silent)
    assert level.seconds >= 40 * 0.02  # what came after step 40 was lost


def test_a_level_that_stopped_early_trains_no_more_when_what_came_after_is_repeated(views, tmp_path, monkeypatch):
    options = replace(QUICK, steps=200, gain=50.0)
    (whole,) = options.fit(views, tmp_path / "whole", silent)
    assert whole.steps < options.steps

    def interrupt(path, grid):
        raise Stop

    with monkeypatch.context() as patch:
        patch.setattr("cltransfer.fit.nerf_grid.write_grid", interrupt)
        with pytest.raises(Stop):
            options.fit(views, tmp_path / "parts", silent)
    told: list[int] = []
    (resumed,) = options.fit(views, tmp_path / "parts", lambda step, done, total: told.append(done))
    assert (told, resumed.steps, resumed.psnr) == ([], whole.steps, whole.psnr)


def test_a_level_is_not_taken_over_by_a_fit_with_other_options_or_views(views, tmp_path):
    def interrupt(step: str, done: int, total: int) -> None:
        if done == 25:
            raise Stop

    with pytest.raises(Stop):
        QUICK.fit(views, tmp_path, interrupt)
    before = (tmp_path / "level_0.safetensors").read_bytes()
    for changed, seen in ((replace(QUICK, rate=0.01), views), (QUICK, views[range(20)])):
        with pytest.raises(UsageError, match="holds a fit with other options or views"):
            changed.fit(seen, tmp_path, silent)
    assert (tmp_path / "level_0.safetensors").read_bytes() == before


def test_an_interrupt_stays_one(views, tmp_path):
    def interrupt(step: str, done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        QUICK.fit(views, tmp_path, interrupt)


@pytest.mark.parametrize("options", [{"budget": 2_000_000_000, "first": 2_000_000_000}, {"budget": 1000}])
def test_what_does_not_fit_in_memory_is_refused_before_it_is_begun(views, tmp_path, monkeypatch, options):
    monkeypatch.setenv("CLTRANSFER_MEMORY", "1" if options["budget"] == 1000 else "100000")
    with pytest.raises(ResourceError, match=r"cells and the rays of 25 images need \d+ MB, .*smaller budget or side"):
        NerfGridFit(**options).fit(views, tmp_path / "grid", silent)
    assert not (tmp_path / "grid").exists()


def test_a_budget_is_reached_whatever_the_gain(views, tmp_path):
    levels = replace(QUICK, budget=5000, steps=20, gain=99.0).fit(views, tmp_path, silent)
    assert [level.kept for level in levels] == [True, True]
    assert levels[-1].cells == pytest.approx(5000, rel=0.1)
    assert json.loads((tmp_path / "fit.json").read_text())["options"]["budget"] == 5000


def test_cells_are_nearly_cubes_and_as_many_as_asked():
    z, y, x = grid_shape(BOX, 50_000)
    assert (z - 1) * (y - 1) * (x - 1) == pytest.approx(50_000, rel=0.05)
    voxel = empty_grid((z, y, x), 0, BOX).voxel
    assert voxel.max() / voxel.min() < 1.05


def test_a_finer_grid_holds_the_same_field():
    random = torch.Generator().manual_seed(0)
    shape = (4, 5, 6)
    grid = NerfGrid(
        torch.rand(shape, generator=random), torch.randn(*shape, 4, 3, generator=random), torch.zeros(shape), BOX
    )
    fine = resampled(grid, (7, 9, 11))
    torch.testing.assert_close(fine.density[::2, ::2, ::2], grid.density)
    torch.testing.assert_close(fine.sh[::2, ::2, ::2], grid.sh)
    torch.testing.assert_close(fine.density[1, 0, 0], (grid.density[0, 0, 0] + grid.density[1, 0, 0]) / 2)


def test_faint_voxels_become_empty_and_cells_near_matter_stay_filled():
    fog = without_faint(empty_grid((9, 9, 9), 0, BOX))
    assert not fog.density.any()
    assert not filled_cells(fog).any()
    fog.density[4, 4, 4] = 1
    filled = filled_cells(fog)
    assert filled.shape == (8, 8, 8)
    assert torch.equal(filled.nonzero().unique(), torch.tensor([2, 3, 4, 5]))
    assert filled.sum() == 64


def test_options_out_of_range_are_named():
    for options, line in (
        ({"budget": "all"}, "budget must be auto or at least 8 cells, got 'all'"),
        ({"degree": 3}, "degree must be 0, 1 or 2"),
        ({"growth": 1}, "growth must be greater"),
        ({"growth": float("inf")}, "growth"),
        ({"rate": float("inf")}, "rate"),
        ({"gain": float("nan")}, "gain"),
        ({"near": float("inf")}, "near"),
        ({"most": -1}, "most must be at least 8"),
        ({"side": 0}, "side must be at least 1"),
        ({"hold_out": 1}, "hold_out must be at least 2"),
        ({"step": 2}, "step must be in"),
    ):
        with pytest.raises(UsageError, match=line):
            FITTERS.build("nerf_grid", options)


@pytest.mark.parametrize("name", ["growth", "gain", "rate", "near"])
def test_an_option_is_a_finite_number(name):
    with pytest.raises(ValueError, match=f"{name} must be finite, got inf"):
        NerfGridFit(**{name: float("inf")})


def test_levels_grow_however_little_is_asked():
    assert NerfGridFit(first=8, most=11, growth=1.0001)._sizes() == [8, 9, 10, 11]


@pytest.mark.parametrize("state", ["[]", '{"levels": 7}', '{"levels": [{"cells": 1}]}', "{}"])
def test_a_damaged_state_is_told_in_one_line(views, tmp_path, state):
    key = {"as": "nerf_grid", "options": asdict(QUICK), "views": views.digest}
    said = json.loads(state)
    (tmp_path / "fit.json").write_text(json.dumps({**key, **said} if said or state == "{}" else said))
    with pytest.raises(InputError, match=r"fit\.json: is not the state of a fit \(choose another folder\)"):
        QUICK.fit(views, tmp_path, silent)


def test_a_near_plane_that_hides_the_scene_is_refused(views, tmp_path):
    small = replace(views.camera, w2c=views.camera.w2c.clone())
    small.w2c[:, :3, 3] *= 0.01
    small = replace(views, camera=small, aabb=0.01 * views.aabb)
    with pytest.raises(UsageError, match=r"near: hides what is nearer than 0.1, the middle .* is 0.03 .*near=0.002"):
        NerfGridFit(budget=64, first=64, steps=1).fit(small, tmp_path / "out", lambda *words: None)
    assert not (tmp_path / "out").exists()
