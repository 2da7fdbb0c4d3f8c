"""The engine is the one asked for, unless something it needs is not there, and then it is said."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import pytest
import torch

from cltransfer.config import load_config
from cltransfer.driver.schedule import LEAN_STEPS, POLISH, UNGUIDED, Schedule, make_schedule
from cltransfer.features import Features
from cltransfer.losses.filmic_space import FilmicSpace
from cltransfer.losses.shot_size import ShotSize
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.objective import Objective
from cltransfer.registry import SEARCHES
from cltransfer.search.paper_box import PaperBox
from cltransfer.search.subject_orbit import SubjectOrbit
from cltransfer.testing import sample_features
from cltransfer.testing.samples import sample_cameras, sample_subject


def schedule(*overrides: str) -> Schedule:
    config = load_config(overrides=overrides)
    objective = Objective(Components.build(config).losses)
    return make_schedule(config, config.build_one("search"), objective, sample_features(0, 2))


@pytest.mark.parametrize("name", SEARCHES.names())
def test_a_search_is_refined_only_if_slopes_tell_every_move(name: str) -> None:
    """About the initial view every change of the camera, in six degrees of freedom and the lens, has a slope."""
    search, home, subject = SEARCHES.build(name), sample_cameras(0, 1), sample_subject()
    x = search.vector(home, home, subject)[0]
    around = x + 1e-4 * torch.eye(len(x), dtype=x.dtype)
    moved = search.cameras(torch.cat([x[None], around]), home, subject)
    slopes = torch.cat([moved.w2c.flatten(1), moved.focal[:, None] / home.focal], dim=1)
    rank = int(torch.linalg.matrix_rank((slopes[1:] - slopes[0]) / 1e-4, tol=1e-3))
    made = schedule(f"search.{name}={{}}")
    assert (rank == 7) == (made.engine == "refine")
    assert (name in made.note) == (made.engine == "cma")


class Own(PaperBox):
    """A search as a plugin may bring one."""

    refinable: ClassVar[bool] = True


@pytest.mark.parametrize("more", [(), ("guide=0",), ("warm_start=false",), ("engine=cma",)])
def test_a_guide_that_a_search_does_not_take_is_told(more: tuple[str, ...]) -> None:
    config = load_config(overrides=more)
    objective, reference = Objective(Components.build(config).losses), sample_features(0, 2)
    notes = [make_schedule(config, search, objective, reference).note for search in (Own(), SubjectOrbit())]
    assert notes == ["" if more else UNGUIDED, ""]


def at_rest(frames: int) -> Features:
    """One frame again and again, without flow."""
    frame = sample_features(0, 2)[1]
    return Features.concatenate([frame.having("flow", torch.zeros_like(frame.require("flow")))] * frames)


@pytest.mark.parametrize("frames", [3, 12, 40])
@pytest.mark.parametrize(("preset", "times"), [("fast", 1), ("balanced", 2)])
def test_where_nothing_moves_the_first_frame_has_generations_for_all_of_them(
    frames: int, preset: str, times: int
) -> None:
    config = load_config(overrides=[f"preset={preset}"])
    objective, search = Objective(Components.build(config).losses), config.build_one("search")
    still = at_rest(frames)
    polish = make_schedule(config, search, objective, still).polish
    assert polish is not None
    assert polish.generations == times * min(frames, POLISH.generations)
    keypoints = still.require("keypoints").clone()
    for frame, change in ((0, 0.05 * still.size[0]), (-1, 0.05 * still.size[0]), (-1, torch.nan)):
        other = keypoints.clone()
        other[frame, :, 0] += change  # one frame alone is different, or shows nothing
        assert not make_schedule(config, search, objective, replace(still, keypoints=other)).still


@pytest.mark.parametrize("losses", [(), ("shot_size", "framing", "filmic_space", "camera_angle")])
def test_a_steady_move_is_no_still_shot_though_every_frame_shows_the_same(losses: tuple[str, ...]) -> None:
    """An orbit about a person who is all that is read, or a pan by its flow alone."""
    config = load_config(overrides=["preset=fast", *(f"losses.{name}=null" for name in losses)])
    objective, search = Objective(Components.build(config).losses), config.build_one("search")
    rest = at_rest(8)
    assert make_schedule(config, search, objective, rest).still
    flow = torch.zeros_like(rest.require("flow"))
    flow[:, 0] = 0.02 * rest.size[0]
    assert not make_schedule(config, search, objective, rest.having("flow", flow)).still


def test_a_loss_that_weighs_nothing_frees_no_lens_and_places_nobody() -> None:
    for override, free in (
        ("losses.filmic_space.weight=0", False),
        ("losses.filmic_space=null", False),
        ("seed=0", True),
    ):
        assert schedule(override).free_lens is free
    weightless = [f"losses.{name}.weight=0" for name in ("shot_size", "framing", "filmic_space", "camera_angle")]
    assert (schedule(*weightless[:3]).placed, schedule(*weightless).placed) == (True, False)


@pytest.mark.parametrize("mode", ["robust", "faithful"])
@pytest.mark.parametrize("zoom", ["auto", "still"])
def test_a_lens_is_free_where_some_frame_shows_what_is_before_or_behind_the_person(zoom: str, mode: str) -> None:
    """Of a person before nothing filmic space is defined, and is 0 whatever the lens."""
    config = load_config(overrides=[f"losses.filmic_space.mode={mode}", "path=smooth", f"zoom={zoom}"])
    objective, search, seen = Components.build(config).objective, config.build_one("search"), sample_features(0, 2)
    layers = torch.zeros_like(seen.require("layers"))
    layers[:, 1] = seen.require("layers")[:, 1]
    for layer in (None, 0, 2):
        there = layers.clone()
        if layer is not None:
            there[1, layer] = ~layers[1, 1]
        reference = replace(seen, layers=there)
        assert make_schedule(config, search, objective, reference).free_lens is (layer is not None)


@dataclass(frozen=True)
class Deeper(FilmicSpace):
    """A plugin's filmic space."""


def test_a_lens_is_free_by_a_class_of_filmic_space_under_another_name_too() -> None:
    config = load_config(overrides=["zoom=auto"])
    search, seen = config.build_one("search"), sample_features(0, 2)
    for deeper, free in ((Deeper(), True), (Deeper(weight=0.0), False), (ShotSize(), False)):
        objective = Objective({"deeper": deeper, "framing": Components.build(config).losses["framing"]})
        assert make_schedule(config, search, objective, seen).free_lens is free


def test_a_loss_that_weighs_nothing_tells_of_no_move() -> None:
    rest = at_rest(8)
    orientation = rest.require("orientation").clone()
    orientation[3] = torch.nan
    gap = replace(rest, orientation=orientation)
    search = SubjectOrbit()
    for weight, still in ((0, True), (5, False)):
        config = load_config(overrides=["preset=fast", f"losses.camera_angle.weight={weight}"])
        assert make_schedule(config, search, Components.build(config).objective, gap).still is still


def test_two_frames_do_not_tell_that_nothing_moves() -> None:
    assert schedule().polish is None


@pytest.mark.parametrize(("steps", "lean"), [(1, 1), (6, LEAN_STEPS)])
def test_a_clip_is_followed_leanly_in_no_more_steps_than_the_config_allows(steps: int, lean: int) -> None:
    assert schedule(f"steps={steps}").lean.refinement.steps == lean


def test_what_is_below_the_noise_is_not_asked_for() -> None:
    config = load_config()
    made = make_schedule(config, SubjectOrbit(), Components.build(config).objective, sample_features(0, 4), noise=10.0)
    assert made.refinement.tolerance == made.budget.tolerance == 5.0
