"""Cameras where none should stand, lenses that nobody makes: finite terms or NaN, never an exception."""

import math

import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.config import load_config
from cltransfer.driver.stage import Stage
from cltransfer.features import Features
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.objective import Objective
from cltransfer.registry import SEARCHES
from cltransfer.scenes import Scene

SIZE = (96, 54)


@pytest.fixture(scope="module")
def stage(courtyard: Scene) -> Stage:
    parts = Components.build(load_config())
    return Stage(courtyard, parts.renderer, parts.plan("scene"), Objective(parts.losses), SIZE)


def view(scene: Scene, distance: float, fov: float = 0.7, away: bool = False) -> Camera:
    """In front of the person at ``distance`` [heights], looking at it or away."""
    person = scene.subject
    assert person is not None
    ahead = person.facing * person.height
    eye = person.anchor + distance * ahead
    target = eye + ahead if away else person.anchor - ahead
    return Camera.look_at(eye[None], target[None], person.up, fov, SIZE)


def totals(stage: Stage, camera: Camera) -> torch.Tensor:
    """Totals of ``camera`` as second frame after an ordinary first, against that frame."""
    first = stage.view(view(stage.scene, 2.5), None)
    reference: Features = stage.features(view(stage.scene, 2.4), first)
    defined = stage.objective.defined(reference)[0]
    assert bool(defined.all())
    return stage.objective.totals(stage.terms(reference, camera, first), defined)


def test_a_person_behind_the_camera_costs_more_than_one_at_the_edge(stage: Stage) -> None:
    behind, good = (float(totals(stage, view(stage.scene, 2.4, away=away))) for away in (True, False))
    assert good < 1e-6
    assert math.isfinite(behind)
    assert behind > 10


@pytest.mark.parametrize("distance", [0.0, 0.02, 0.1, 1e-9, 300.0])
def test_a_camera_inside_the_person_or_far_outside_is_priced(stage: Stage, distance: float) -> None:
    total = float(totals(stage, view(stage.scene, distance)))
    assert math.isfinite(total)
    assert total > 1


@pytest.mark.parametrize("fov", [1e-4, 0.01, math.radians(175)])
def test_an_extreme_lens_is_priced(stage: Stage, fov: float) -> None:
    total = float(totals(stage, view(stage.scene, 2.4, fov)))
    assert math.isfinite(total)
    assert total > 1


@pytest.mark.parametrize("name", ["paper_box", "subject_orbit"])
def test_every_corner_of_a_search_is_a_camera_that_can_be_rendered(stage: Stage, name: str) -> None:
    search = SEARCHES.build(name)
    home = view(stage.scene, 2.5)
    low, high = (bound.clamp(-10, 10) for bound in search.bounds())
    generator = torch.Generator().manual_seed(0)
    corner = torch.rand(24, search.dimensions, generator=generator, dtype=torch.float64) < 0.5
    cameras = search.cameras(torch.where(corner, low, high), home, stage.scene.subject)
    assert bool(torch.isfinite(cameras.w2c).all() and torch.isfinite(cameras.K).all())
    assert bool((cameras.focal > 0).all())
    assert bool(torch.isfinite(totals(stage, cameras)).all())


def test_a_paper_box_focal_factor_of_zero_is_clamped_above_it(courtyard: Scene) -> None:
    search, home = SEARCHES.build("paper_box"), view(courtyard, 2.5)
    x = search.vector(home, home, None)
    x[:, 7] = -1
    torch.testing.assert_close(search.cameras(x, home, None).focal, 0.05 * home.focal)


def test_no_camera_is_better_than_the_true_one_by_hiding_the_person(stage: Stage) -> None:
    """Leaving the frame, entering the body and looking away are all dearer than a camera that is a little off."""
    near = float(totals(stage, view(stage.scene, 2.6)))
    for hiding in (view(stage.scene, 2.4, away=True), view(stage.scene, 0.0), view(stage.scene, 2.4, 0.001)):
        assert near < float(totals(stage, hiding))
