"""Every stressor makes worse what it says, by its level, and nothing else."""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import fields, replace

import numpy as np
import pytest
import torch

from cltransfer.bench.stress.case import Case, Film
from cltransfer.bench.stress.filming import FILMING, faster, reshaped
from cltransfer.bench.stress.reading import READING
from cltransfer.bench.stress.scenery import SCENERY
from cltransfer.bench.stress.trial import STRESSORS
from cltransfer.bench.stress.viewing import VIEWING
from cltransfer.features import Features
from cltransfer.renderers.gaussian_splats import GaussianSplats
from cltransfer.scenes.builtin import builtin_scene
from cltransfer.shots import shot
from cltransfer.testing import sample_features

CHANGES = {
    "lost_joints": "keypoints",
    "shifted_depth": "depth",
    "wild_flow": "flow",
    "low_texture": "flow",
    "flipped_yaw": "orientation",
}


@pytest.fixture(scope="module")
def case() -> Case:
    scene = builtin_scene("courtyard")
    assert scene.subject is not None
    path = shot("static", scene.subject, (96, 54), 20)
    return Case(sample_features(0, 20), path.times, scene, path.camera[0])


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(seed))


def far(before: Features, after: Features, name: str) -> float:
    """Mean absolute change of a feature where it is known."""
    return float((after.require(name).double() - before.require(name).double()).abs().nanmean())


def changed(before: object, after: object) -> list[str]:
    """Names of the tensors that differ."""
    names = []
    for field in fields(before):  # type: ignore[arg-type]
        a, b = getattr(before, field.name), getattr(after, field.name)
        if isinstance(a, torch.Tensor) and (a.shape != b.shape or not torch.equal(a.nan_to_num(7), b.nan_to_num(7))):
            names.append(field.name)
    return names


def test_there_are_at_least_ten_with_five_rising_levels_each() -> None:
    assert len(STRESSORS) >= 10
    for name, stressor in STRESSORS.items():
        rising = list(stressor.levels) == sorted(stressor.levels)
        falling = list(stressor.levels) == sorted(stressor.levels, reverse=True)
        assert rising or falling, name
        assert len(set(stressor.levels)) == 5


@pytest.mark.parametrize("name", [*READING, *SCENERY, *VIEWING])
def test_the_same_seed_gives_the_same_stress_and_the_given_case_is_left_alone(case: Case, name: str) -> None:
    stressor = STRESSORS[name]
    kept = deepcopy(case)
    one, two = (stressor.strain(case, stressor.levels[2], rng(3)) for _ in range(2))
    for a, b in ((one.reference, two.reference), (one.scene.geometry, two.scene.geometry), (one.view, two.view)):
        assert changed(a, b) == []
    for a, b in ((kept.reference, case.reference), (kept.scene.geometry, case.scene.geometry), (kept.view, case.view)):
        assert changed(a, b) == []


@pytest.mark.parametrize("name", READING)
def test_reading_changes_its_own_feature_more_at_every_level(case: Case, name: str) -> None:
    stressor, feature = READING[name], CHANGES[name]
    worse = [stressor.strain(case, level, rng()) for level in stressor.levels]
    assert changed(case.reference, worse[-1].reference) == [feature]
    amounts = [far(case.reference, one.reference, feature) for one in worse]
    assert amounts == sorted(amounts)
    assert amounts[0] > 0


def test_a_share_is_the_share() -> None:
    reference = sample_features(0, 20)
    reference = replace(reference, keypoints=reference.require("keypoints").clone())
    given = Case(reference, torch.arange(20.0), None, None)  # type: ignore[arg-type]
    lost = READING["lost_joints"].strain(given, 0.35, rng()).reference.require("keypoints")
    assert int((lost[..., 2] == 0).sum()) == round(0.35 * 20 * 14)
    turned = READING["flipped_yaw"].strain(given, 0.3, rng()).reference.require("orientation")
    difference = (turned - reference.require("orientation"))[:, 0]
    torch.testing.assert_close(difference.sort().values, torch.tensor([0.0] * 14 + [math.pi] * 6))


def test_shifted_depth_shrinks_ratios_as_a_shift_does(case: Case) -> None:
    """Inverse depth d + s: what was ten times as far is less than ten times as far."""
    before = case.reference.require("depth")
    after = READING["shifted_depth"].strain(case, 0.8, rng()).reference.require("depth")
    span = [(d.flatten(1).amax(1) / d.flatten(1).amin(1)).log() for d in (before, after)]
    assert bool((span[1] < 0.8 * span[0]).all())


def test_pruning_leaves_the_share_it_says(case: Case) -> None:
    worse = SCENERY["pruned"].strain(case, 0.7, rng())
    assert len(worse.scene.geometry) == pytest.approx(0.3 * len(case.scene.geometry), abs=1)


def test_floaters_hang_in_the_air_and_are_nobody(case: Case) -> None:
    before = case.scene.geometry
    after = SCENERY["floaters"].strain(case, 50, rng()).scene.geometry
    new = after.means[len(before) :].double()
    subject = case.scene.subject
    assert subject is not None
    assert len(new) == 50
    assert bool(((new - subject.anchor) @ subject.up >= -1e-6).all())
    assert float(after.label[len(before) :].max()) == 0


def test_the_occluder_hides_more_of_the_person_at_every_level(case: Case) -> None:
    stressor = SCENERY["occluder"]
    seen = []
    for worse in (case, *(stressor.strain(case, level, rng()) for level in stressor.levels)):
        drawn = GaussianSplats().render(worse.scene, worse.view, frozenset({"label"}))
        seen.append(float(drawn.require("label").sum()))
    assert seen == sorted(seen, reverse=True)
    assert seen[-1] < 0.2 * seen[0]


def test_the_double_is_as_large_as_the_person_and_not_labelled(case: Case) -> None:
    before = case.scene.geometry
    after = SCENERY["second_person"].strain(case, 0.8, rng()).scene.geometry
    person = before.means[before.label > 0.5]
    double = after.means[len(before) :]
    assert float(after.label[len(before) :].max()) == 0
    shift = double - person
    torch.testing.assert_close(shift, shift[:1].expand_as(shift), atol=1e-4, rtol=0)
    assert case.scene.subject is not None
    assert float(shift[0].norm()) == pytest.approx(0.8 * case.scene.subject.height, rel=1e-4)


def test_a_turned_view_sees_the_person_in_the_same_place_from_elsewhere(case: Case) -> None:
    subject = case.scene.subject
    assert subject is not None
    view = VIEWING["turned_view"].strain(case, 90, rng()).view
    before, after = (v.project(subject.anchor[None])[0] for v in (case.view, view))
    torch.testing.assert_close(before, after)
    a, b = (torch.nn.functional.normalize(v.center - subject.anchor, dim=1) for v in (case.view, view))
    level_a, level_b = (d - (d @ subject.up)[:, None] * subject.up for d in (a, b))
    assert abs(float((level_a * level_b).sum())) < 1e-9


@pytest.mark.parametrize(("name", "factor"), [("nearer_view", 0.6), ("farther_view", 1.4)])
def test_a_moved_view_looks_the_same_way_from_another_distance(case: Case, name: str, factor: float) -> None:
    subject = case.scene.subject
    assert subject is not None
    view = VIEWING[name].strain(case, 0.4, rng()).view
    torch.testing.assert_close(view.w2c[:, :3, :3], case.view.w2c[:, :3, :3])
    ratio = (view.center - subject.anchor).norm() / (case.view.center - subject.anchor).norm()
    assert float(ratio) == pytest.approx(factor)


def test_film_is_hurried_or_reshaped() -> None:
    film = Film(12, (640, 360))
    assert [faster(film, speed).frames for speed in FILMING["fast_motion"].levels] == [8, 6, 4, 3, 2]
    assert reshaped(film, 0.5).size == (180, 360)
