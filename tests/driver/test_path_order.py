"""The least order: no more knots than the motion needs, no moving lens where it stands, never a path that costs."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import pytest
import torch

from cltransfer.config import load_config
from cltransfer.driver import path_order
from cltransfer.driver.joint import Effort
from cltransfer.driver.path_order import JUMPS, LeastPath, cuts, least_path
from cltransfer.driver.stage import Stage, read_path
from cltransfer.driver.whole_clip import WholeClip
from cltransfer.features import Features
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.objective import Objective
from cltransfer.pipeline.plan import Step
from cltransfer.run.flags import run_flags
from cltransfer.scenes.load import load_scene
from cltransfer.search.paper_box import PaperBox
from cltransfer.search.subject_orbit import SubjectOrbit
from cltransfer.shots import shot
from cltransfer.transfer import Inputs, Result, transfer

KNOTS = {"static": (1,), "push_in": (4, 6, 8), "pan": (4, 6, 8), "crash_zoom": (None,)}
COST = {"static": 9.5, "push_in": 11.7, "pan": 12.9, "crash_zoom": 11.0}  # evaluations a frame of preset fast
DEARER = 1.3  # times as many are too many


@pytest.fixture(scope="module")
def taught(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Result]:
    """A shot in the plaza, taught to the plaza."""
    subject = load_scene("builtin:plaza").subject
    assert subject is not None

    def run(name: str, *overrides: str, frames: int = 16) -> Result:
        path = tmp_path_factory.mktemp("shot") / "shot.json"
        shot(name, subject, (320, 180), frames).save(path)
        small = ["search_side=96", "output_side=96", "threads=1", "preset=fast", *overrides]
        return transfer(Inputs("builtin:plaza", f"builtin:plaza@{path}"), load_config(overrides=small))

    return run


def order(result: Result) -> LeastPath:
    path = result.kept.path
    assert path is not None
    return path


@pytest.mark.parametrize("name", KNOTS)
def test_a_shot_takes_the_knots_its_motion_needs(taught: Callable[..., Any], name: str) -> None:
    result = taught(name)
    path = order(result)
    assert path.knots in KNOTS[name]
    assert path.total <= path.free + path.floor
    assert result.spent.evaluations / len(result.reference) < DEARER * COST[name]


def test_the_lens_is_kept_in_an_orbit_and_moves_in_a_zoom(taught: Callable[..., Any]) -> None:
    turn, zoom = taught("orbit", "search_side=160"), taught("zoom")
    focal = turn.trajectory.camera.focal
    assert order(turn).lens_kept
    assert float(focal.max() / focal.min()) == pytest.approx(1.0, abs=1e-6)
    assert not order(zoom).lens_kept


def test_an_exact_path_is_left_as_it_was_found(taught: Callable[..., Any]) -> None:
    result = taught("static", "path=exact", "frames=6")
    assert result.kept.path is None
    assert torch.equal(result.trajectory.camera.w2c, result.kept.found.camera.w2c)


@pytest.mark.slow  # the next one searches without residuals, too
def test_a_search_without_residuals_is_smoothed_too(taught: Callable[..., Any]) -> None:
    path = order(taught("static", "frames=6", "engine=cma", "generations=15"))
    assert path.total <= path.free + path.floor
    assert path.knots is None or path.knots < 6


def test_a_path_is_refined_as_a_whole_however_its_frames_were_found(taught: Callable[..., Any]) -> None:
    each, whole = (
        taught("push_in", "frames=4", "engine=cma", "generations=8", "warm_start=false", f"joint={rounds}")
        for rounds in (0, 2)
    )
    assert order(whole).total < 0.9 * order(each).total
    assert order(whole).name.endswith("refined as a whole")
    assert not order(each).refined


@dataclass(frozen=True)
class Reader:
    """What takes a network pass a frame and gives nothing new."""

    passes: int
    requires: tuple[str, ...] = ("depth",)
    provides: tuple[str, ...] = ("depth",)

    def __call__(self, now: Features, before: Features | None = None) -> Features:
        return now


def test_no_differences_are_taken_through_networks() -> None:
    scene = load_scene("builtin:plaza")
    assert scene.subject is not None
    parts, path = Components.build(load_config()), shot("push_in", scene.subject, (96, 54), 5)
    search, spent = SubjectOrbit(), []
    for passes in (0, 1):
        plan = parts.plan("scene")
        plan = replace(plan, steps=(*plan.steps, Step("reader", Reader(passes))))
        stage = Stage(scene, parts.renderer, plan, Objective(parts.losses), (96, 54))
        clip = WholeClip(stage, search, read_path(stage, path.camera), path.camera[0])
        x = search.vector(path.camera, path.camera[0], scene.subject) + 0.05
        least_path(clip, x, None, 0.0, Effort(2, 4))
        spent.append(stage.spent.evaluations)
    assert spent[1] < 5 * 8 < spent[0]  # differences take 8 evaluations a frame


def test_fast_motion_that_the_reference_makes_is_not_filtered_away(taught: Callable[..., Any]) -> None:
    path = order(taught("crash_zoom", "search_side=160", frames=24))
    assert path.name != "every frame"
    assert path.total < 0.05  # filtered without the guide it costs 0.2 more


def waving(period: int, frames: int = 16) -> tuple[WholeClip, torch.Tensor]:
    """A clip and its true path, a camera that goes up and down within ``period`` frames."""
    scene, parts, search = load_scene("builtin:plaza"), Components.build(load_config()), SubjectOrbit()
    assert scene.subject is not None
    held = shot("static", scene.subject, (96, 54), frames).camera
    true = search.vector(held, held[0], scene.subject)
    true[:, 5] += 0.2 * torch.sin(torch.arange(frames) * math.tau / period)
    stage = Stage(scene, parts.renderer, parts.plan("scene"), Objective(parts.losses), (96, 54))
    clip = WholeClip(stage, search, read_path(stage, search.cameras(true, held[0], scene.subject)), held[0])
    return clip, true


# what float32 leaves of frames that are equal, and frames that are
@pytest.mark.parametrize("rounded", [pytest.param(0.0, marks=pytest.mark.slow), 1e-6])
def test_a_path_that_stands_still_as_it_was_found_stays_so_and_never_costs_more(rounded: float) -> None:
    clip, _ = waving(period=8, frames=6)
    x = clip.search.vector(clip.home, clip.home, clip.stage.scene.subject).expand(6, -1).clone()
    x[::3] += rounded
    path = least_path(clip, x, None, 0.0, Effort(1, 4))
    assert (path.knots, path.lens_kept) == (1, True)
    assert path.name.startswith("static")
    assert bool((path.x == path.x[0]).all())
    assert path.total <= path.free


def test_a_path_that_bends_less_never_costs_more_than_is_allowed() -> None:
    clip, x = waving(period=12, frames=12)
    x[:, 3] += 0.05  # too far away
    path = least_path(clip, x, None, 0.0, Effort(2, 4))
    assert path.knots is not None
    assert path.total <= path.free + path.floor


def test_what_a_path_may_cost_more_than_its_frames_is_a_fiftieth_of_it_and_what_nobody_sees() -> None:
    clip, x = waving(period=3, frames=8)
    x[:, 3] += 0.7  # far too far away
    path = least_path(clip, x, None, 0.05, Effort(0, 0))
    assert path.free > 1
    assert path.floor == pytest.approx(0.05 + 0.01 + 0.02 * path.free)


def test_the_bends_that_the_reference_makes_are_free_when_a_filtered_path_is_refined() -> None:
    clip, true = waving(period=3)
    x = true.clone()
    x[:, 3] += 0.1
    x[::2, 4] += 0.03  # shakes
    path = least_path(clip, x, None, 0.0, Effort(1, 4), guide=true)
    assert path.filtered
    assert path.refined
    assert path.total < 0.1 < path.free  # where its bends cost something no path comes below the free one


@pytest.mark.parametrize(("beside", "jumps"), [(0.1, True), (0.8, False)])
def test_a_jump_stays_only_where_frames_fit_well(beside: float, jumps: bool) -> None:
    scene, parts, search = load_scene("builtin:plaza"), Components.build(load_config()), SubjectOrbit()
    assert scene.subject is not None
    held = shot("static", scene.subject, (96, 54), 12).camera
    true = search.vector(held, held[0], scene.subject)
    true[::2, 5] += 0.06  # every other frame is higher
    stage = Stage(scene, parts.renderer, parts.plan("scene"), Objective(parts.losses), (96, 54))
    clip = WholeClip(stage, search, read_path(stage, search.cameras(true, held[0], scene.subject)), held[0])
    x = true.clone()
    x[:, 3] += beside  # too far away
    path = least_path(clip, x, None, 0.0, Effort(0, 4))
    assert (path.name == "every frame") == jumps
    assert path.total - path.free == pytest.approx(0.0 if jumps else 0.59, abs=0.05)


@pytest.mark.parametrize(("beside", "severed"), [(0.05, False), (0.0, True)])
def test_a_cut_that_the_reference_does_not_make_stays_only_where_anything_else_is_far_dearer(
    beside: float, severed: bool
) -> None:
    scene, parts, search = load_scene("builtin:plaza"), Components.build(load_config()), SubjectOrbit()
    assert scene.subject is not None
    held = shot("static", scene.subject, (96, 54), 12).camera
    guide = search.vector(held, held[0], scene.subject)
    x = guide.clone()
    x[6:, 3] += 0.9  # twice as far away
    stage = Stage(scene, parts.renderer, parts.plan("scene"), Objective(parts.losses), (96, 54))
    clip = WholeClip(stage, search, read_path(stage, search.cameras(x, held[0], scene.subject)), held[0])
    x[:, 5] += beside
    assert cuts(x, guide) == [6]
    assert cuts(x, x) == cuts(x, None) == []
    whole = least_path(clip, x, None, 0.0, Effort(0, 4), guide)
    assert cuts(whole.x, guide) == ([6] if severed else [])
    assert (whole.total > JUMPS * whole.free) == (not severed)
    assert least_path(clip, x, None, 0.0, Effort(0, 4)).name == "every frame"  # the reference may jump as well


@pytest.mark.parametrize(("apart", "seen"), [(0.39, []), (0.41, [3])])
def test_a_cut_is_a_jump_of_half_the_distance_that_the_camera_makes_and_not_the_reference(
    apart: float, seen: list[int]
) -> None:
    held = torch.zeros(6, 7, dtype=torch.float64)
    jumps = held.clone()
    jumps[3:, 3] = apart
    assert cuts(jumps, held) == seen
    assert cuts(held, jumps) == []


def test_a_filtered_path_that_refining_makes_too_dear_stays_as_it_was_filtered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cltransfer.driver.spline.STIFFNESS", 1e7)  # straightens whatever moves
    clip, x = waving(period=4)
    x[:, 3] += 0.7
    x[::2, 4] += 0.03
    free, _ = clip.scored(x)
    path = path_order._filtered(clip, LeastPath(x, None, 0.0, False, free, free, 0.01), None, free + 0.01, Effort(1, 4))
    assert path.filtered
    assert not path.refined


def test_a_spline_that_refining_makes_too_dear_stays_as_it_was_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cltransfer.driver.spline.STIFFNESS", 1e7)  # straightens whatever moves
    clip, x = waving(period=12, frames=12)
    x[:, 3] += 0.1
    path = least_path(clip, x, None, 0.0, Effort(1, 1))
    assert path.name == "4 knots, focal length kept"
    assert path.total <= path.free + path.floor


@pytest.mark.parametrize("shown", [2, 4])
@pytest.mark.parametrize(("beside", "measured"), [(0.02, False), (0.05, True)])
def test_whether_frames_fit_well_is_told_by_those_that_show_somebody(beside: float, measured: bool, shown: int) -> None:
    clip, x = waving(period=8, frames=4)
    gone = {name: clip.reference.require(name).clone() for name in ("keypoints", "subject", "layers", "orientation")}
    for value in gone.values():
        value[shown:] = False if value.dtype == torch.bool else torch.nan
    clip = replace(clip, reference=replace(clip.reference, **gone))
    x[:, 3] += beside  # too far away
    path = least_path(clip, x, None, 0.0, Effort(1, 1))
    assert (path.local is not None) == measured


@pytest.mark.parametrize(("noise", "knots"), [(0.2, 2), (0.05, 4)])
def test_no_spline_leaves_the_bounds_that_its_frames_stand_at(noise: float, knots: int) -> None:
    clip, _ = waving(period=8)
    search, person = PaperBox(translation=0.2), clip.stage.scene.subject
    x = torch.zeros(16, 8, dtype=torch.float64)
    x[:, 0] = torch.linspace(0.2, 1.4, 16).clamp(max=1.0)
    x[:, 4], x[:, 7] = 0.1, 2 / search.focal - 1
    reference = read_path(clip.stage, search.cameras(x, clip.home, person))
    path = least_path(replace(clip, search=search, reference=reference), x, None, noise, Effort(0, 0))
    assert path.knots == knots
    assert float(path.x.abs().max()) == 1.0


@dataclass
class Priced:
    """A clip of which only what a filtered path costs is known: in turn as listed."""

    totals: list[float]
    at: None = None  # evenly spaced

    def inside(self, x: torch.Tensor, kept: torch.Tensor | None = None) -> torch.Tensor:
        return x

    def scored(self, x: torch.Tensor) -> tuple[float, torch.Tensor]:
        return self.totals.pop(0), torch.zeros(len(x), 1)


@pytest.mark.parametrize(("totals", "filtered"), [([0.4, 0.3], 1), ([0.3], 0), ([0.4] * 9, None)])
def test_the_next_filter_is_tried_where_refining_does_not_help(
    totals: list[float], filtered: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(path_order, "refine_path", lambda clip, x, residuals, moves, effort: (x, residuals))
    free = LeastPath(torch.zeros(6, 7), None, 0.0, False, 0.2, 0.2, 0.14)
    path = path_order._filtered(Priced(totals), free, None, 0.34, Effort(4, 6))  # type: ignore[arg-type]
    assert path.filtered == (0.0 if filtered is None else path_order.FILTERS[filtered])
    assert path.total == (0.2 if filtered is None else 0.3)


def test_a_path_is_refined_until_it_costs_no_more_than_its_frames_did(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[float] = []

    def refine_path(clip: Any, x: torch.Tensor, residuals: torch.Tensor, moves: Any, effort: Effort) -> Any:
        asked.append(moves.enough)
        return x, residuals

    monkeypatch.setattr(path_order, "refine_path", refine_path)
    free = LeastPath(torch.zeros(6, 7), None, 0.0, False, 0.2, 0.2, 0.14)
    path_order._filtered(Priced([0.3]), free, None, 0.34, Effort(4, 6))  # type: ignore[arg-type]
    assert asked == [0.2]


@pytest.mark.parametrize("shaken", [0.0, 0.06])
def test_a_lens_that_is_to_keep_still_does_whatever_it_costs(shaken: float) -> None:
    """The reference zooms by a fifth, so that frames which zoom cost nothing, and no path that does not comes near."""
    clip, true = waving(period=8)
    lens = clip.lens(7)
    assert lens is not None
    true = true + 0.2 * torch.linspace(0, 1, len(true), dtype=torch.float64)[:, None] * lens / (lens @ lens)
    true[::2, 5] += shaken
    person = clip.stage.scene.subject
    zooming = replace(clip, reference=read_path(clip.stage, clip.search.cameras(true, clip.home, person)))
    free = least_path(zooming, true, None, 0.0, Effort(1, 4))
    still = least_path(zooming, true, None, 0.0, Effort(1, 4), still=True)
    ranges = [float(focal.max() / focal.min()) for focal in (zooming.cameras(p.x).focal for p in (free, still))]
    assert ranges == [pytest.approx(math.exp(0.2), abs=0.02), pytest.approx(1.0, abs=1e-6)]
    assert (free.lens_kept, still.lens_kept) == (False, True)
    assert "focal length kept, filtered" in still.name
    assert still.total > free.total


@pytest.mark.parametrize("preset", ["fast", "balanced"])
def test_a_lens_that_is_kept_is_kept_where_the_camera_may_come_no_nearer(
    taught: Callable[..., Any], preset: str
) -> None:
    result = taught("push_in", "zoom=still", f"preset={preset}", "search.subject_orbit.nearest=2.9")
    focal = result.trajectory.camera.focal
    assert order(result).lens_kept
    assert any("distance at its bound" in flag.reason for flag in run_flags(result))
    assert float(focal.max() / focal.min()) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("shot", ["pan", "zoom"])
def test_a_transfer_keeps_the_lens_still_on_demand(taught: Callable[..., Any], shot: str) -> None:
    result = taught(shot, "zoom=still")
    focal = result.trajectory.camera.focal
    assert float(focal.max() / focal.min()) == pytest.approx(1.0, abs=1e-6)
    assert order(result).lens_kept
    assert ("the lens zooms" in str([flag.reason for flag in run_flags(result)])) is False
