"""What a reader of a run is told that no number says."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.config import load_config
from cltransfer.driver.path_order import LeastPath
from cltransfer.losses.camera_movement import CameraMovement
from cltransfer.losses.shot_size import ShotSize
from cltransfer.pipeline.objective import Objective
from cltransfer.registry import RENDERERS
from cltransfer.renderers.gaussian_splats import GaussianSplats
from cltransfer.run.flags import run_flags
from cltransfer.run.scene_end import SCENE_ENDS
from cltransfer.scenes.floaters import floaters
from cltransfer.scenes.load import load_scene
from cltransfer.scenes.person.lifted import load_person
from cltransfer.scenes.splats import Splats
from cltransfer.search.paper_box import PaperBox
from cltransfer.trajectory import Trajectory
from cltransfer.transfer import Inputs, Result, transfer

TINY = ["preset=fast", "frames=2", "search_side=48", "output_side=96"]


@pytest.mark.parametrize("people", [None, 1, 2, 3])
def test_other_people_in_the_scene_are_told(plain: Result, tmp_path: Path, people: int | None) -> None:
    subject = plain.scene.subject
    assert subject is not None
    replace(subject, people=people).save(tmp_path / "subject.json")
    scene = load_person(plain.scene, tmp_path / "subject.json")
    told = [flag.reason for flag in run_flags(replace(plain, scene=scene)) if "one is filmed" in flag.reason]
    assert [reason.partition(",")[0] for reason in told] == [f"{people} people in the scene"] * ((people or 1) > 1)


def test_what_was_left_out_of_the_search_is_told(plain: Result) -> None:
    geometry = load_scene("builtin:plaza").geometry
    assert isinstance(geometry, Splats)
    assert plain.floaters == int(floaters(geometry).sum()) > 0
    (told,) = [flag.reason for flag in run_flags(plain) if "hang in the air" in flag.reason]
    assert told.endswith(f": {plain.floaters}, left out of the search (floaters=keep would search with them)")
    (told,) = [flag.reason for flag in run_flags(kept(plain, left_out=None)) if "hang in the air" in flag.reason]
    assert told.endswith(f": {plain.floaters}, searched with them: what is found without is far worse among them")
    whole = transfer(Inputs("builtin:plaza", "builtin:push_in"), load_config(overrides=[*TINY, "floaters=keep"]))
    assert whole.floaters == 0
    assert not any("hang in the air" in flag.reason for flag in run_flags(whole))


def test_a_person_nearer_than_what_is_drawn_whole_is_told_with_what_would_draw_them(plain: Result) -> None:
    def told(**options: float) -> list[str]:
        result = replace(plain, renderer=GaussianSplats(**options))  # type: ignore[arg-type]
        return [flag.reason for flag in run_flags(result) if "faded or cut" in flag.reason]

    person, cameras = plain.scene.subject, plain.trajectory.camera
    assert person is not None
    pixels, depth = cameras.project(person.joints)
    shown = ((pixels >= 0) & (pixels < pixels.new_tensor(cameras.size))).all(-1) & (depth > 0)
    far, near = depth.where(shown, torch.inf).amin(1).tolist()
    assert told() == told(near=0.1, near_fade=near - 0.2) == []
    (one,) = told(near=0.1, near_fade=near)
    assert one.startswith(f"the person is faded or cut in 1 of 2 frames, as near as {near:.2g} scene units: set ")
    (both,) = told(near=far + 0.1, near_fade=0)
    assert "in 2 of 2 frames" in both
    options = dict(part.split("=") for part in both.split(": set ")[1].split())
    assert told(**{name.removeprefix("renderer.gaussian_splats."): float(v) for name, v in options.items()}) == []


def test_a_person_behind_the_camera_is_not_near_to_it(plain: Result) -> None:
    camera = plain.trajectory.camera
    about = torch.diag(torch.tensor([-1.0, 1.0, -1.0, 1.0], dtype=torch.float64))
    away = replace(plain.trajectory, camera=replace(camera, w2c=about @ camera.w2c))
    assert not any("faded or cut" in flag.reason for flag in run_flags(replace(plain, trajectory=away)))


@dataclass(frozen=True)
class Odd:
    """The renderer of a plugin, whose ``near`` may be anything."""

    near: Any = None
    near_fade: Any = 9.0


@pytest.mark.parametrize("near", [None, "0.1", [1.0], True, float("nan")])
def test_a_near_plane_that_is_no_number_is_not_told_of(plain: Result, near: object) -> None:
    assert not any("faded or cut" in flag.reason for flag in run_flags(replace(plain, renderer=Odd(near))))


def test_the_options_that_are_told_are_those_of_the_renderer_in_use(
    plain: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("", "odd"):
        if name:
            monkeypatch.setitem(RENDERERS._classes, name, Odd)
        (told,) = [flag.reason for flag in run_flags(replace(plain, renderer=Odd(1))) if "faded or cut" in flag.reason]
        above = "renderer.odd." if name else ""
        assert re.search(rf": set {above}near=[\d.]+ {above}near_fade=[\d.]+$", told)


@pytest.fixture(scope="module")
def plain() -> Result:
    """A push in into the plaza, its frames as they were found: nothing is wrong with it."""
    return transfer(Inputs("builtin:plaza", "builtin:push_in"), load_config(overrides=[*TINY, "path=exact"]))


def kept(result: Result, **changes: Any) -> Result:
    attempts = list(result.attempts)
    attempts[result.best] = replace(result.kept, **changes)
    return replace(result, attempts=tuple(attempts))


def blocked(result: Result) -> Result:
    return kept(result, doubtful={**result.kept.doubtful, "the person is hidden": torch.tensor([False, True])})


def on_bound(result: Result) -> Result:
    x = result.kept.found.x.clone()
    x[1, 6] -= result.search.bounds()[1][3] - x[1, 3]  # by the same lens
    x[1, 3] = result.search.bounds()[1][3]
    return kept(result, found=replace(result.kept.found, x=x))


def widest(result: Result) -> Result:
    x = result.kept.found.x.clone()
    x[1, 6] = (math.log(0.99 * result.search.widest) - 0.8 * x[1, 3]) / 0.8
    return kept(result, found=replace(result.kept.found, x=x))


def undetermined(result: Result) -> Result:
    local = result.kept.found.local
    assert local is not None
    jacobian = local.jacobian.clone()
    jacobian[1, :, 2] = 0
    return kept(result, found=replace(result.kept.found, local=replace(local, jacobian=jacobian)))


def undetermined_by_cma(result: Result) -> Result:
    """What only its path has measured."""
    local, found = undetermined(result).kept.found.local, replace(result.kept.found, local=None)
    return kept(result, found=found, path=LeastPath(found.x, None, 0.0, False, 1.0, 1.0, 0.1, local=local))


def undefined(result: Result) -> Result:
    shown = result.kept.shown
    values = {term.name: term.values.clone() for term in shown.scores.terms}
    values["framing"][1] = values["camera_movement"][0] = torch.nan  # the first frame never has flow
    terms = tuple(replace(term, values=values[term.name]) for term in shown.scores.terms)
    return kept(result, shown=replace(shown, read=replace(shown.read, scores=replace(shown.scores, terms=terms))))


def test_a_term_that_every_frame_has_lost_is_told_of_every_frame(plain: Result) -> None:
    shown, reason = plain.kept.shown, "undefined on every frame of the render"
    lost = [replace(t, values=torch.full((2,), torch.nan), reason=reason) for t in shown.scores.terms]
    lost[2] = replace(lost[2], reason="the reference has no 'depth'")
    gone = kept(plain, shown=replace(shown, read=replace(shown.read, scores=replace(shown.scores, terms=tuple(lost)))))
    reference = plain.reference.features
    bare = replace(plain.reference, features=replace(reference, depth=None, extras={}))
    flags = run_flags(replace(gone, reference=bare))
    framed = [(flag.frame, flag.reason) for flag in flags if flag.reason.endswith(" undefined")]
    placed = [(i, f"{name} undefined") for i in (0, 1) for name in ("shot_size", "framing", "camera_angle")]
    assert sorted(framed) == sorted([*placed, (1, "camera_movement undefined")])


def test_a_result_worse_than_standing_still_or_than_the_search_took_it_for_is_told(plain: Result) -> None:
    def told(found: float, searched: float = 1.0) -> list[str]:
        shown = plain.kept.shown
        scores, search = (replace(shown.scores, totals=torch.full((2,), total)) for total in (found, searched))
        result = kept(
            replace(plain, searched=search, held=search), shown=replace(shown, read=replace(shown.read, scores=scores))
        )
        return [flag.reason for flag in run_flags(result) if "the total is" in flag.reason]

    assert told(1.04) == []
    assert told(1.06) == ["worse than the first view held still: the total is 1.06 for 1"]
    assert told(1.06, 1.5) == []
    assert len(told(0.9, 0.1)) == 1  # worse, and of little either
    (_, otherwise) = told(4.5)
    assert otherwise.startswith("the total is 4.5, for 1 in the search, most of it ")
    assert otherwise.endswith(": the search and the reading do not see the same")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (blocked, "the person is hidden"),
        (on_bound, "distance at its bound (search.subject_orbit.farthest=30)"),
        (widest, "focal length at its limit"),
        (undetermined_by_cma, "degenerate: some change of the camera costs nothing, it is not determined"),
        (undetermined, "degenerate: some change of the camera costs nothing, it is not determined"),
        (undefined, "framing undefined"),
    ],
)
def test_what_is_doubtful_in_a_frame_is_told_of_that_frame_alone(
    plain: Result, change: Callable[[Result], Result], reason: str
) -> None:
    before = [(flag.frame, flag.reason) for flag in run_flags(plain)]
    after = [(flag.frame, flag.reason) for flag in run_flags(change(plain))]
    assert all(frame is None for frame, _ in before)
    assert after == [*before, (1, reason)]


def test_where_the_scene_ends_is_told_once_of_all_frames(plain: Result) -> None:
    ends = kept(plain, doubtful={**plain.kept.doubtful, SCENE_ENDS: torch.tensor([False, True])})
    told = [flag for flag in run_flags(ends) if SCENE_ENDS in flag.reason]
    assert [(flag.frame, flag.reason) for flag in told] == [(None, f"{SCENE_ENDS}, in 1 of 2 frames")]


def test_a_free_axis_whose_length_means_nothing_leaves_no_camera_undetermined(
    plain: Result,
) -> None:
    boxed = replace(undetermined(plain), search=PaperBox())
    assert not [flag for flag in run_flags(boxed) if "degenerate" in flag.reason]


@pytest.mark.parametrize(
    ("loss", "told"),
    [
        (ShotSize(), ["fewer than two key joints in the reference: the size is that of the mask, and not certain"]),
        (ShotSize(joints="all"), []),
        (ShotSize(mode="faithful"), []),
        (None, []),
    ],
)
def test_a_size_of_the_mask_is_told_where_a_loss_takes_it_from_there(
    plain: Result, loss: ShotSize | None, told: list[str]
) -> None:
    keypoints = plain.reference.features.require("keypoints").clone()
    keypoints[1, 2:, 2] = 0.0  # the shoulders alone: one key joint of two joints
    reference = replace(plain.reference, features=replace(plain.reference.features, keypoints=keypoints))
    losses = {name: other for name, other in plain.objective.losses.items() if name != "shot_size"}
    objective = Objective(losses if loss is None else {**losses, "shot_size": loss})
    flags = run_flags(replace(plain, reference=reference, objective=objective))
    assert [flag.reason for flag in flags if flag.frame == 1] == told


def test_a_sliver_of_a_mask_is_no_size(plain: Result) -> None:
    keypoints, mask = (plain.reference.features.require(name).clone() for name in ("keypoints", "subject"))
    keypoints[1, 2:, 2], mask[1] = 0.0, False
    mask[1, 0, 0] = True
    features = replace(plain.reference.features, keypoints=keypoints, subject=mask)
    flags = run_flags(replace(plain, reference=replace(plain.reference, features=features)))
    assert not any("fewer than two" in flag.reason for flag in flags)


@pytest.mark.parametrize(
    ("zoom", "depth", "told"),
    [
        (1.0, True, "which the reference does not"),
        (1.0, False, "which the reference does not"),
        (1.5, True, ""),
        (None, True, "which the reference, as its flow and depth tell, does not"),
        (None, False, ""),
    ],
)
def test_a_lens_that_zooms_where_that_of_the_reference_stands_is_told(
    plain: Result, zoom: float | None, depth: bool, told: str
) -> None:
    """Of a scene its own lens tells, whatever was read of it; of a clip its flow and depth, if it has both."""
    reference = replace(plain.reference, zoom=zoom)
    if not depth:
        reference = replace(reference, features=replace(reference.features, depth=None))
    K = plain.trajectory.camera.K.clone()
    K[1:, [0, 1], [0, 1]] *= 1.5
    camera = replace(plain.trajectory.camera, K=K)
    result = replace(plain, reference=reference, trajectory=replace(plain.trajectory, camera=camera))
    flags = [flag.reason for flag in run_flags(result) if "the lens zooms" in flag.reason]
    assert [flag.partition("times, ")[2].partition(":")[0] for flag in flags] == [told] * bool(told)
    assert all(flag.endswith("zoom=fixed keeps that of the first frame") for flag in flags)  # there is no path
    path = LeastPath(torch.zeros(len(plain.reference), 7), None, 0.0, False, 0.0, 0.0, 0.0)
    smooth = run_flags(kept(result, path=path))
    assert sum(flag.reason.endswith("zoom=still keeps one focal length") for flag in smooth) == bool(told)


@pytest.mark.parametrize("mode", ["robust", "faithful"])
def test_a_movement_in_pixels_that_is_weighed_as_if_in_frame_widths_is_told(plain: Result, mode: Any) -> None:
    objective = Objective({**plain.objective.losses, "camera_movement": CameraMovement(mode=mode)})
    told = [flag for flag in run_flags(replace(plain, objective=objective)) if "camera_movement counts" in flag.reason]
    width = plain.reference.features.size[0]
    assert [(flag.frame, f" {width} times " in flag.reason) for flag in told] == [(None, True)] * (mode == "faithful")


def test_a_bound_is_told_where_it_limits_the_camera(plain: Result) -> None:
    x = torch.zeros(2, 8, dtype=torch.float64)
    x[0, 4] = x[1, 7] = 1.0
    boxed = replace(kept(plain, found=replace(plain.kept.found, x=x)), search=PaperBox())
    assert [flag.reason for flag in run_flags(boxed) if "bound" in flag.reason] == ["gamma at its bound"]


@pytest.mark.parametrize("translation", [0.1, 5.0, 1000.0])
def test_a_search_whose_room_is_of_another_unit_is_told(plain: Result, translation: float) -> None:
    flags = run_flags(replace(plain, search=PaperBox(translation=translation)))
    told = [flag.frame for flag in flags if "translation=" in flag.reason]
    assert told == [None] * (translation != 5.0)


def test_a_focal_length_that_is_kept_is_told_with_what_names_another(tmp_path: Path) -> None:
    person = load_scene("builtin:plaza").subject
    assert person is not None
    eye = (person.anchor + 4 * person.facing)[None]
    view = Camera.look_at(eye, person.anchor[None], person.up, math.radians(25), (160, 90))
    Trajectory(view, torch.zeros(1, dtype=torch.float64)).save(tmp_path / "view.json")
    config = load_config(overrides=["preset=fast", "frames=1", "search_side=48", "output_side=96", "zoom=fixed"])
    for init, lens in (
        ("auto", "40 degrees high, 27.8 mm"),  # 54 of 96 px: 20.25 mm of the gate are its height
        (str(tmp_path / "view.json"), "25 degrees high, 45.7 mm"),
    ):
        flags = run_flags(transfer(Inputs("builtin:plaza", "builtin:static", init), config))
        told = [flag.reason for flag in flags if "focal length" in flag.reason]
        assert told == [f"focal length kept at {lens} on a gate 36 mm wide (--init VIEW.json names another)"]


@pytest.mark.parametrize("empty", [False, True])
def test_that_nobody_is_read_in_the_render_is_told(plain: Result, empty: bool) -> None:
    """Of a frame in which the reference shows nobody either nothing is missing."""
    shown = plain.kept.shown
    points = torch.full_like(shown.features.require("keypoints"), torch.nan)
    terms = tuple(
        replace(term, values=torch.full((2,), torch.nan)) if term.name in ("shot_size", "camera_angle") else term
        for term in shown.scores.terms
    )
    scores = replace(shown.scores, terms=terms, totals=torch.full((2,), 62.0))
    gone = replace(shown, read=replace(shown.read, features=replace(shown.features, keypoints=points), scores=scores))
    keypoints = plain.reference.features.require("keypoints").clone()
    keypoints[:empty] = torch.nan
    reference = replace(plain.reference, features=replace(plain.reference.features, keypoints=keypoints))
    result = kept(replace(plain, family="image", reference=reference), shown=gone)
    told = [flag.reason for flag in run_flags(result) if flag.frame is None]
    line = f"see nobody in {2 - empty} of 2 frames of the render"
    assert [reason for reason in told if line in reason and "total is 62" in reason]
    assert not [reason for reason in told if "most of it" in reason]


def test_an_angle_that_leaps_away_at_an_end_of_the_clip_is_told() -> None:
    result = transfer(Inputs("builtin:plaza", "builtin:push_in"), load_config(overrides=[*TINY, "frames=4"]))
    angles = result.reference.features.require("orientation").clone()
    angles[0, 1] += 1.0
    reference = replace(result.reference, features=replace(result.reference.features, orientation=angles))

    def told(family: str) -> list[int | None]:
        flags = run_flags(replace(result, reference=replace(reference, family=family)))  # type: ignore[arg-type]
        return [flag.frame for flag in flags if "leaps away" in flag.reason]

    assert told("image") == [0]
    assert told("scene") == []  # what a scene tells is so


def test_where_the_camera_jumps_and_the_reference_does_not_is_told(plain: Result) -> None:
    told = [flag for flag in run_flags(kept(plain, cuts=[1])) if "the camera jumps here" in flag.reason]
    assert [flag.frame for flag in told] == [1]
    assert plain.kept.cuts == []
