"""What the baselines are given: losses, budgets and how they go about it, as their presets and docs/protocol.md say."""

from __future__ import annotations

from typing import Any

import pytest

from cltransfer.bench.driver import settings
from cltransfer.bench.methods import config_of
from cltransfer.config import load_config
from cltransfer.config.adam import AdamConfig
from cltransfer.config.options import RunConfig

FIVE = {
    "shot_size": ("robust", 10.0),
    "framing": ("robust", 10.0),
    "filmic_space": ("robust", 4.0),
    "camera_movement": ("robust", 40.0),
    "camera_angle": ("robust", 4.0),
}
PRINTED = {name: ("faithful", weight) for name, (_, weight) in FIVE.items()} | {"camera_movement": ("faithful", 0.0625)}
JAWS, JAWS_CODE = ({"jaws_pose": (quirks, 0.3), "jaws_flow": (quirks, 0.7)} for quirks in (False, True))
THOUSAND = {"engine": "cma", "generations": 100, "popsize": 10, "patience": 20}
AS_PAPERS = {"path": "exact", "zoom": "free", "floaters": "keep", "guard": False, "clean": 0.0}
BY_CMA = {**THOUSAND, **AS_PAPERS, "sigma0": 0.1, "tolerance": 0.0, "warm_start": False}
BY_ADAM = {"engine": "adam", **AS_PAPERS, "warm_start": True}
BOX, TURNING = {"paper_box": {}}, {"se3_jaws": {}}
GIVEN: dict[str, tuple[dict[str, Any], dict[str, Any], dict[str, Any]]] = {  # losses, search, how it is gone about
    "paper": (FIVE, BOX, BY_CMA),
    "cma": (FIVE, {"subject_orbit": {}}, {**THOUSAND, "sigma0": 0.3, "tolerance": 0.02, "warm_start": True}),
    "five_adam": (FIVE, TURNING, {**BY_ADAM, "adam": AdamConfig(42, 0.025, "one", "fixed")}),
    "jaws_clean": (JAWS, TURNING, {**BY_ADAM, "adam": AdamConfig(40, 0.025, "two", "gradnorm")}),
    "jaws_code": (
        *(JAWS_CODE, {"se3_jaws": {"unit_axis": False}}),
        {**BY_ADAM, "adam": AdamConfig(40, 0.025, "two", "gradnorm", quirks=True)},
    ),
    "jaws_losses_cma": (JAWS, BOX, BY_CMA),
}


def losses_of(config: RunConfig) -> dict[str, Any]:
    """Mode, or of a loss of JAWS whether it has the quirks of its code, and weight by name."""
    losses = config.build("losses").items()
    return {name: (loss.mode if hasattr(loss, "mode") else loss.quirks, loss.weight) for name, loss in losses}


def among(config: RunConfig, told: dict[str, Any]) -> dict[str, Any]:
    """What ``config`` has of that which is ``told``."""
    return {key: getattr(config, key) for key in told}


@pytest.mark.parametrize("name", GIVEN)
def test_a_baseline_has_the_losses_and_the_whole_budget_that_it_is_said_to_have(name: str) -> None:
    config, (losses, search, told) = config_of(name, "room-1", 3), GIVEN[name]
    assert losses_of(config) == losses
    assert config.search == search
    assert among(config, told) == told


def test_the_paper_searches_by_the_very_losses_of_ours_on_either_bench() -> None:
    ours = config_of("balanced", "room-1", 0).build("losses")
    assert losses_of(settings("paper", 0)) == FIVE
    theirs = [settings("paper", 0), settings("balanced", 0), *(config_of(n, "room-1", 0) for n in ("paper", "cma"))]
    assert all(config.build("losses") == ours for config in theirs)  # in what is beside mode and weight too


def test_the_driver_bench_gives_the_paper_its_whole_budget_on_the_features_of_ours() -> None:
    paper, ours = settings("paper", 7), settings("balanced", 7)
    assert paper.search == BOX
    assert among(paper, BY_CMA) == BY_CMA
    same = {"search_side": 160, "output_side": 160, "threads": 1, "seed": 7}
    for config in (paper, ours):
        assert among(config, same) == same
        assert config.extract.inner == "geometric"


def test_the_paper_s_preset_by_itself_has_the_losses_as_printed() -> None:
    assert losses_of(load_config(overrides=["preset=paper"])) == PRINTED
