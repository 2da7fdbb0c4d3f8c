"""Between a stressed clip and its row: what the search is given, and what its cameras are judged by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import torch

from cltransfer.bench.stress import trial as stressed
from cltransfer.bench.stress.case import Case
from cltransfer.bench.stress.trial import STRESSORS, StressTrial, run_stress
from cltransfer.config.options import RunConfig
from cltransfer.features import Features
from cltransfer.reading.feature_file import FeatureFile
from cltransfer.scenes import Scene
from cltransfer.scenes.load import load_scene
from cltransfer.trajectory import Trajectory
from cltransfer.transfer import Inputs, Result

READ = ("keypoints", "depth", "flow", "orientation", "layers", "subject")
Strain = Callable[[Case, float, np.random.Generator], Case]


def kept(strain: Strain, cases: list[Case]) -> Strain:
    """``strain``, of which ``cases`` hold the calm case and the stressed one."""

    def strained(case: Case, level: float, rng: np.random.Generator) -> Case:
        cases[:] = case, strain(case, level, rng)
        return cases[1]

    return strained


def parts(reference: Features, scene: Scene, view: Trajectory) -> dict[str, list[torch.Tensor]]:
    """What tells two cases apart, by what a stressor changes."""
    return {
        "reference": [reference.require(name) for name in READ],
        "scene": [scene.geometry.means],
        "view": [view.camera.w2c, view.camera.K],
    }


def parts_of(case: Case) -> dict[str, list[torch.Tensor]]:
    return parts(case.reference, case.scene, Trajectory(case.view, torch.zeros(1)))


def same(one: list[torch.Tensor], other: list[torch.Tensor]) -> bool:
    pairs = [(a.double(), b.double()) for a, b in zip(one, other, strict=True)]
    return all(a.shape == b.shape and torch.allclose(a, b, equal_nan=True) for a, b in pairs)


@pytest.mark.parametrize(
    ("name", "changed"), [("flipped_yaw", "reference"), ("turned_view", "view"), ("second_person", "scene")]
)
def test_a_search_is_given_the_stressed_case_and_judged_by_the_clip_before_it(
    name: str, changed: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    cases: list[Case] = []
    given: list[dict[str, list[torch.Tensor]]] = []

    def true_cameras(inputs: Inputs, config: RunConfig) -> Result:
        """What a search finds that nothing leads astray: a shot that stands, in the scene that it is from."""
        read = FeatureFile.load(str(inputs.reference)).features
        given.append(parts(read, load_scene(inputs.scene, inputs.up), Trajectory.load(inputs.init)))
        view, times = cases[0].view, cases[0].times
        search = config.build_one("search")
        held: Any = SimpleNamespace(trajectory=Trajectory(view[[0] * len(times)], times), search=search)
        held.kept = SimpleNamespace(x=torch.zeros(len(times), search.dimensions))
        return cast(Result, held)

    monkeypatch.setitem(STRESSORS, name, replace(STRESSORS[name], strain=kept(STRESSORS[name].strain, cases)))
    monkeypatch.setattr(stressed, "transfer", true_cameras)
    monkeypatch.setattr(stressed, "_chance", lambda clip, frames: 10.0)  # of random views, which take long
    row = run_stress(StressTrial("fast", name, 5, "static", "plaza-2", "plaza-2", 1, 2))
    calm, worse = map(parts_of, cases)
    assert {part: same(given[0][part], worse[part]) for part in worse} == dict.fromkeys(worse, True)
    assert [part for part in calm if not same(given[0][part], calm[part])] == [changed]
    assert row["total"] == pytest.approx(0, abs=1e-3)  # against a person who is turned it would be something
