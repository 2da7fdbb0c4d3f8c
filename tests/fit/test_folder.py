"""A folder is one fit's as soon as that has left something in it, and not before."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from cltransfer.errors import InputError, ResourceError, UsageError
from cltransfer.fit import gaussian_splats, nerf_grid
from cltransfer.fit._curve import Level
from cltransfer.fit._folder import WRITTEN, begun, check_folder, write_state
from cltransfer.fit._views import Views
from cltransfer.fit.nerf_grid import NerfGridFit

QUICK = NerfGridFit(first=200, most=200, steps=6, look=3, rays=64, degree=0)
NAMES = ["curve.csv", "curve.svg", "fit.json", "grid.safetensors"]
KEY, OTHER = {"as": "nerf_grid", "options": {"seed": 0}}, {"as": "gaussian_splats", "options": {"seed": 0}}
LEVEL = Level(cells=8, filled=8, psnr=20.0, steps=1, seconds=1.0, kept=True)


def silent(step: str, done: int, total: int) -> None:
    """Nobody listens."""


def test_a_folder_in_which_nothing_was_left_is_anybody_s(tmp_path: Path) -> None:
    write_state(tmp_path, KEY, [])
    assert begun(tmp_path, KEY, "grid") == begun(tmp_path, OTHER, "grid") == []
    (tmp_path / "level_0.safetensors").write_bytes(b"learnt")
    assert begun(tmp_path, KEY, "grid") == []
    with pytest.raises(UsageError, match="holds a fit with other options or views"):
        begun(tmp_path, OTHER, "grid")


def test_a_folder_in_which_a_fit_was_killed_as_it_wrote_is_anybody_s(tmp_path: Path) -> None:
    for name in ("fit.json", "level_0.safetensors", "grid.safetensors"):
        (tmp_path / f".tmp-7-0123abcd-{name}").touch()
    check_folder(tmp_path)
    write_state(tmp_path, KEY, [])
    assert begun(tmp_path, OTHER, "grid") == []
    (tmp_path / ".tmp-7-0123abcd-thesis.tex").touch()
    with pytest.raises(UsageError, match="holds a fit with other options or views"):
        begun(tmp_path, OTHER, "grid")


def test_the_files_of_fits_are_those_that_they_write() -> None:
    names = ("fit.json", "curve.csv", "curve.svg", gaussian_splats.SCENE, nerf_grid.GRID, "level_0.safetensors")
    assert all(WRITTEN.fullmatch(name) for name in names)


def test_a_folder_with_a_level_is_not_taken_over_though_the_scene_is_gone(tmp_path: Path) -> None:
    write_state(tmp_path, KEY, [LEVEL])
    with pytest.raises(UsageError, match="holds a fit with other options or views"):
        begun(tmp_path, OTHER, "grid")


def test_after_too_large_a_budget_the_same_folder_takes_a_smaller_one(
    views: Views, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setenv("CLTRANSFER_MEMORY", "100000")
        with pytest.raises(ResourceError, match="take a smaller budget or side"):
            replace(QUICK, budget=2_000_000_000, first=2_000_000_000).fit(views, tmp_path, silent)
    assert not list(tmp_path.iterdir())
    assert len(replace(QUICK, budget=200).fit(views, tmp_path, silent)) == 1


def test_after_a_fit_that_learnt_nothing_the_same_folder_takes_other_options(views: Views, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nothing was learnt .* \(a smaller sparse= or near=; do poses fit\?\)"):
        replace(QUICK, steps=60, sparse=1e3).fit(views, tmp_path, silent)
    assert [path.name for path in tmp_path.iterdir()] == ["fit.json"]
    QUICK.fit(views, tmp_path, silent)
    assert json.loads((tmp_path / "fit.json").read_text())["options"]["sparse"] == QUICK.sparse


@pytest.mark.parametrize("step", ["write_curve", "write_grid", "write_state"])
def test_a_fit_that_was_killed_while_it_wrote_leaves_all_when_it_is_repeated(
    views: Views, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    write = getattr(nerf_grid, step)

    def killed(folder: Path, *words: object) -> None:
        write(folder, *words)
        if step != "write_state" or words[1]:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(nerf_grid, step, killed)
        with pytest.raises(KeyboardInterrupt):
            QUICK.fit(views, tmp_path, silent)
    (level,) = QUICK.fit(views, tmp_path, silent)
    assert level.steps == 6
    assert sorted(path.name for path in tmp_path.iterdir()) == NAMES


def test_where_levels_are_done_a_smaller_budget_is_for_another_folder(
    views: Views, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def shrink(step: str, done: int, total: int) -> None:
        monkeypatch.setenv("CLTRANSFER_MEMORY", "1")

    with pytest.raises(ResourceError, match="take a smaller budget or side, in another folder"):
        replace(QUICK, budget=400).fit(views, tmp_path, shrink)
