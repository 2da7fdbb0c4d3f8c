"""Frames in which something hides the person go aside together, past it; where nothing is gained the path stays."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pytest
import torch
from torch import Tensor

from cltransfer.bench.stress.case import Case
from cltransfer.bench.stress.scenery import occluder
from cltransfer.config import load_config
from cltransfer.driver.aside import BESIDE, FEW, MANY, _lost, as_a_whole, go_aside, steadiest
from cltransfer.driver.stage import Stage, read_path
from cltransfer.driver.whole_clip import WholeClip, views
from cltransfer.features import Features
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.objective import Objective
from cltransfer.scenes.load import load_scene
from cltransfer.search.paper_box import PaperBox
from cltransfer.search.subject_orbit import DISTANCE, SCALE, SIZE, SubjectOrbit
from cltransfer.shots import shot

FRAMES, HIDDEN = 16, 8


@pytest.fixture(scope="module")
def behind() -> tuple[WholeClip, Tensor]:
    """An orbit whose true path (N, 7) passes behind a narrow board, which the reference did not have."""
    scene, parts, search = load_scene("builtin:plaza"), Components.build(load_config()), SubjectOrbit()
    assert scene.subject is not None
    path = shot("orbit", scene.subject, (96, 54), FRAMES).camera
    clean = Stage(scene, parts.renderer, parts.plan("scene"), Objective(parts.losses), (96, 54))
    case = Case(None, None, scene, path[HIDDEN])  # type: ignore[arg-type]
    stage = replace(clean, scene=occluder(case, 0.06, np.random.default_rng(1)).scene)
    clip = WholeClip(stage, search, read_path(clean, path), path[0])
    return clip, search.vector(path, path[0], scene.subject)


def test_it_goes_past_what_hides_the_person_and_nowhere_else(behind: tuple[WholeClip, Tensor]) -> None:
    clip, true = behind
    residuals = clip.residuals(true)
    hidden = clip.totals(residuals) > 1.0
    before = clip.stage.spent.evaluations
    x, found = go_aside(clip, true, residuals, hidden)
    first = int(hidden.nonzero()[0, 0])
    assert 4 < first < FRAMES - 3
    assert float(clip.totals(residuals)[first:].mean()) > 1.5
    assert float(clip.totals(found)[first:].mean()) < 0.8  # measured 0.55, 0.27 of it for going there
    torch.testing.assert_close(clip.totals(found), clip.totals(clip.residuals(x)))
    assert float((x - true)[:5].abs().max()) < 1e-3  # a way is 0.05 to 0.15
    assert float((x - true).diff(n=3, dim=0).abs().max()) < 0.02  # no jump
    tried = len(SubjectOrbit().aside) * len(range(first - BESIDE, FRAMES, FEW.every))
    assert clip.stage.spent.evaluations - before == tried + 2 * FRAMES  # of the path, here once more


def test_more_tries_cost_more_and_lead_no_worse(behind: tuple[WholeClip, Tensor]) -> None:
    clip, true = behind
    residuals = clip.residuals(true)
    hidden = clip.totals(residuals) > 1.0
    few, many = (clip.mean_total(go_aside(clip, true, residuals, hidden, tries=tries)[1]) for tries in (FEW, MANY))
    assert many < few < clip.mean_total(residuals)


def test_no_way_gains_by_what_the_motion_of_the_path_costs(behind: tuple[WholeClip, Tensor]) -> None:
    clip, true = behind
    residuals = clip.residuals(true)
    of_motion = clip.totals(residuals * clip.stage.objective.paired)
    assert float(of_motion[HIDDEN]) > 0.1
    here = _lost(clip, true[HIDDEN : HIDDEN + 1], residuals[HIDDEN], HIDDEN)
    np.testing.assert_allclose(here, 0.0, atol=1e-9)


def test_a_lens_that_is_kept_stays(behind: tuple[WholeClip, Tensor]) -> None:
    clip, true = behind
    residuals = clip.residuals(true)
    x, _ = go_aside(clip, true, residuals, clip.totals(residuals) > 1.0, lens_kept=True)
    assert x is not true
    torch.testing.assert_close(clip.cameras(x).K, clip.cameras(true).K)
    free, kept = clip.aside(7), clip.aside(7, lens_kept=True)
    assert free is not None
    assert kept is not None
    assert (len(free), len(kept)) == (10, 8)


@pytest.mark.parametrize("kept", [True, False])
def test_a_path_with_another_lens_changes_it_where_that_saves_unless_it_is_kept(
    kept: bool, behind: tuple[WholeClip, Tensor]
) -> None:
    clip, true = behind
    other = true.clone()
    other[:, DISTANCE] += 0.13 / SCALE[DISTANCE]  # farther away at the same size
    x, _ = go_aside(clip, other, clip.residuals(other), torch.arange(FRAMES) < HIDDEN - BESIDE, lens_kept=kept)
    assert torch.allclose(clip.cameras(x).K, clip.cameras(other).K) == kept


@dataclass(frozen=True)
class Coming(SubjectOrbit):
    """A search whose only way aside comes nearer by a tenth, with the same lens."""

    @property
    def aside(self) -> Tensor:
        way = torch.zeros(1, 7, dtype=torch.float64)
        way[0, DISTANCE], way[0, SIZE] = -0.1 / SCALE[DISTANCE], 0.1 / SCALE[SIZE]
        return way


def test_a_lens_that_is_kept_stays_where_the_camera_may_come_no_nearer(behind: tuple[WholeClip, Tensor]) -> None:
    clip, true = behind
    far = true - Coming().aside
    nearest = float((true[:, DISTANCE] * SCALE[DISTANCE]).mean().exp()) * 1.05  # it comes half of the way
    clip = replace(clip, search=Coming(nearest=nearest))
    x, _ = go_aside(clip, far, clip.residuals(far), torch.arange(FRAMES) < HIDDEN - BESIDE, lens_kept=True)
    assert x is not far
    torch.testing.assert_close(clip.cameras(x).K, clip.cameras(far).K)


def test_a_camera_that_stands_is_tried_nearby_too_and_with_another_lens(behind: tuple[WholeClip, Tensor]) -> None:
    clip, _ = behind
    aside, nearby = clip.aside(7, lens_kept=True), clip.aside(7, lens_kept=True, stands=True)
    assert aside is not None
    assert nearby is not None
    assert len(nearby) == len(SubjectOrbit().aside) + len(SubjectOrbit().nearby)
    assert len({tuple(way) for way in nearby.tolist()}) == len(nearby)
    assert torch.equal(
        (nearby[:, None] + nearby).abs().sum(-1).amin(0), torch.zeros(len(nearby)).double()
    )  # either way
    six = clip.aside(6, stands=True)
    assert six is not None
    assert six.tolist() == [way[:6] for way in nearby.tolist() if way[6] == 0]  # no lens to change: none is no way


@pytest.mark.parametrize("gone_in", [1, 5])
def test_a_camera_that_stands_still_goes_as_a_whole_and_stands(behind: tuple[WholeClip, Tensor], gone_in: int) -> None:
    """Its first frames were not read: that tells nothing, and does not keep the others from going."""
    clip, true = behind
    hidden = int((clip.totals(clip.residuals(true)) > 1.0).nonzero()[0, 0])
    rest = clip.reference[hidden].having("flow", torch.zeros_like(clip.reference[hidden].require("flow")))
    gone = {name: torch.full_like(rest.require(name), torch.nan) for name in ("keypoints", "orientation", "depth")}
    unread = replace(rest, subject=torch.zeros_like(rest.require("subject")), **gone)
    unread = replace(unread, layers=torch.zeros_like(rest.require("layers")))
    still = replace(clip, reference=Features.concatenate([*[unread] * gone_in, *[rest] * (8 - gone_in)]))
    assert still.placed.tolist() == [False] * gone_in + [True] * (8 - gone_in)
    before, start = still.stage.spent.evaluations, true[hidden].repeat(8, 1)
    x, found = go_aside(still, start, still.residuals(start), still.placed, tries=as_a_whole(8, stands=True))
    assert bool((x != start).any())
    assert float(still.totals(found)[6]) < 0.8 * float(still.totals(still.residuals(start))[6])
    assert bool((x == x[0]).all())
    ways = still.aside(7, stands=True)
    assert ways is not None
    assert still.stage.spent.evaluations - before == len(ways) + 3 * views(x) == len(ways) + 6


def test_where_nothing_is_in_the_way_the_path_stays(behind: tuple[WholeClip, Tensor]) -> None:
    clip, true = behind
    residuals = clip.residuals(true)
    before = clip.stage.spent.evaluations
    x, found = go_aside(clip, true, residuals, torch.arange(FRAMES) < 3)
    assert x is true
    assert found is residuals
    assert clip.stage.spent.evaluations - before == len(SubjectOrbit().aside) * len(range(0, 3 + BESIDE, FEW.every))
    before = clip.stage.spent.evaluations
    assert go_aside(clip, true, residuals, torch.zeros(FRAMES, dtype=torch.bool))[0] is true
    assert clip.stage.spent.evaluations == before


def test_a_search_without_ways_aside_stays(behind: tuple[WholeClip, Tensor]) -> None:
    clip, true = behind
    other = replace(clip, search=PaperBox())
    residuals = clip.residuals(true)
    assert go_aside(other, true, residuals, torch.ones(FRAMES, dtype=torch.bool))[0] is true


def test_no_other_choice_is_cheaper() -> None:
    rng = np.random.default_rng(3)
    costs, change = rng.uniform(0, 1, (3, 5)), 0.3 * (1 - np.eye(3))

    def total(ways: tuple[int, ...]) -> float:
        return float(costs[ways, range(5)].sum() + change[ways[:-1], ways[1:]].sum())

    assert total(tuple(steadiest(costs, change))) == pytest.approx(min(map(total, product(range(3), repeat=5))))
