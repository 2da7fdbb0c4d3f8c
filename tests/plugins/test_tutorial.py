"""The tutorial runs as it is written: its loss, its test and the names it promises."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from cltransfer.ablate.drawn import draw_references
from cltransfer.ablate.read import read_sweep
from cltransfer.config import load_config
from cltransfer.driver.schedule import make_schedule
from cltransfer.paired import FEWEST
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.objective import Objective
from cltransfer.plugins import allow
from cltransfer.registry import LOSSES
from cltransfer.testing import sample_features

README = Path(__file__).resolve().parents[2] / "plugins" / "README.md"
PLUGIN, TEST = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
(ABLATION,) = re.findall(r"```yaml\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "headroom.py").write_text(PLUGIN)
    (tmp_path / "test_headroom.py").write_text(TEST)
    (tmp_path / "mine.yaml").write_text(ABLATION)
    return tmp_path


@pytest.fixture
def allowed(folder: Path) -> Iterator[None]:
    """The tutorial's loss is registered during a test and forgotten after it."""
    allow([folder / "headroom.py"])
    yield
    del LOSSES._classes["headroom"]


def test_tutorial_loss_measures_the_room_above_the_head(allowed: None) -> None:
    features = sample_features(1, 2)
    lower = replace(features, keypoints=features.keypoints + torch.tensor([0, 0.25 * features.size[1], 0]))
    value = LOSSES.build("headroom", {"weight": 20.0})(features, lower)
    torch.testing.assert_close(value, torch.full((2,), 0.25, dtype=value.dtype))


def test_tutorial_loss_is_refined_and_not_searched_by_cma_es_alone(allowed: None) -> None:
    config = load_config(overrides=["losses.headroom.weight=20"])
    objective, search = Objective(Components.build(config).losses), config.build_one("search")
    schedule = make_schedule(config, search, objective, sample_features(0, 2))
    assert (schedule.engine, schedule.note) == ("refine", "")


def test_tutorial_ablation_measures_both_of_its_rows_by_the_loss(allowed: None, folder: Path) -> None:
    sweep = read_sweep(str(folder / "mine.yaml"))
    assert len(ABLATION.splitlines()) == 7
    assert ["headroom" in row.config.losses for row in sweep.rows] == [False, True]
    assert "headroom" in Components.build(sweep.metrics).losses


def test_tutorial_ablation_has_references_enough_for_an_interval(allowed: None, folder: Path) -> None:
    sweep = read_sweep(str(folder / "mine.yaml"))
    assert len(draw_references(sweep, folder)) == FEWEST


def test_tutorial_test_passes_the_contract(folder: Path) -> None:
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--rootdir", str(folder), "test_headroom.py"]
    home = os.pathsep.join([str(folder), str(README.parents[1])])
    done = subprocess.run(
        command, cwd=folder, env={**os.environ, "PYTHONPATH": home}, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stdout
    assert re.search(r"\b15 passed", done.stdout)


def test_tutorial_fits_on_a_page() -> None:
    tutorial = README.read_text(encoding="utf-8").partition("## A representation of your own")[0]
    assert len(tutorial.splitlines()) <= 101
