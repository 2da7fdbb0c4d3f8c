"""What a result is worth, nobody left out; which way it errs: the signs say of the render what they are named after."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import pytest
import torch

from cltransfer.ablate.measure import JERK, Measured, Way, _judged, directions, measured
from cltransfer.ablate.read import read_sweep
from cltransfer.ablate.trial import Job, run_trial, trials
from cltransfer.camera import Camera
from cltransfer.config import load_config
from cltransfer.driver.stage import Stage, read_path
from cltransfer.features import Features, OfThisRun
from cltransfer.pipeline.objective import Objective
from cltransfer.reading.reference import Reference
from cltransfer.skeleton import key_joints

W, H = 160, 90
SIGNS = ("larger", "further right", "further down", "background farther", "foreground farther")


def filmed(tall: float = 40.0, at: tuple[float, float] = (80.0, 45.0), background: float = 8.0) -> Features:
    """Two frames of a person at 4 m whose key joints are ``tall`` pixels tall about ``at``; the ground at 2 m."""
    joints = torch.ones(2, 14, 3, dtype=torch.float64)
    joints[..., 1] = torch.linspace(0, 1, 14)
    key = key_joints(joints)[0, :, 1]
    joints[..., 0], joints[..., 1] = at[0], at[1] + tall * (joints[..., 1] - key.mean()) / (key.max() - key.min())
    layers = torch.zeros(2, 3, H, W, dtype=torch.bool)
    depth = torch.full((2, H, W), math.nan)
    for k, (rows, far) in enumerate(((slice(0, 30), 2.0), (slice(30, 60), 4.0), (slice(60, 90), background))):
        layers[:, k, rows], depth[:, rows] = True, far
    return Features((W, H), keypoints=joints, subject=layers[:, 1], depth=depth, layers=layers)


def ways(rendered: Features, *overrides: str) -> dict[str, Way]:
    return dict(directions(Objective(load_config(overrides=overrides).build("losses")), filmed(), rendered))


@pytest.mark.parametrize(
    ("rendered", "expected"),
    [
        (filmed(), {}),
        (filmed(tall=58.0), {"larger": 0.2}),
        (filmed(at=(96.0, 45.0)), {"further right": 0.1}),
        (filmed(at=(80.0, 54.0)), {"further down": 0.1}),
        (filmed(background=16.0), {"background farther": math.log(2)}),
    ],
    ids=["as it is", *SIGNS[:4]],
)
def test_a_direction_is_positive_where_the_render_is_what_it_says(
    rendered: Features, expected: dict[str, float]
) -> None:
    found = ways(rendered)
    assert tuple(found) == SIGNS
    for sign, way in found.items():
        assert way.mean == pytest.approx(expected.get(sign, 0.0), abs=1e-3), sign
    assert [way.unit for way in found.values()] == ["frame"] * 3 + ["log ratio"] * 2


def test_a_direction_is_the_mean_of_the_frames_that_have_it() -> None:
    rendered = filmed(at=(96.0, 45.0))
    rendered.require("keypoints")[1] = torch.nan
    assert ways(rendered)["further right"].mean == pytest.approx(0.1)
    rendered.require("keypoints")[0] = torch.nan
    assert math.isnan(ways(rendered)["further right"].mean)


def test_a_frame_without_a_value_is_not_counted_as_one_that_has_it() -> None:
    rendered = filmed()
    counts = []
    for frame in (0, 1):
        counts.append(ways(rendered)["larger"].defined)
        rendered.require("keypoints")[frame] = torch.nan
    assert [*counts, ways(rendered)["larger"].defined] == [2, 1, 0]


@pytest.mark.parametrize("mode", ["robust", "faithful"])
@pytest.mark.parametrize(("layer", "sign"), [(0, "foreground farther"), (2, "background farther")])
def test_a_layer_that_a_side_lacks_is_neither_farther_nor_nearer(mode: str, layer: int, sign: str) -> None:
    without = filmed()
    without.require("layers")[:, layer] = False
    losses = Objective(load_config(overrides=[f"losses.filmic_space.mode={mode}"]).build("losses"))
    for reference, rendered in ((filmed(), without), (without, filmed()), (without, without)):
        found = dict(directions(losses, reference, rendered))
        other = next(name for name in SIGNS[3:] if name != sign)
        assert (found[sign].defined, found[other].defined, found[other].mean) == (0, 2, 0.0)


def test_two_losses_that_say_the_same_of_their_residuals_are_told_apart() -> None:
    losses = load_config().build("losses")
    half = replace(losses["shot_size"], joints="all")
    found = dict(directions(Objective({**losses, "whole": half}), filmed(), filmed(tall=58.0)))
    assert tuple(found) == ("larger, shot_size", *SIGNS[1:], "larger, whole")
    assert found["larger, shot_size"].mean == pytest.approx(0.2, abs=1e-3)
    assert found["larger, whole"].mean != pytest.approx(0.2, abs=1e-3)


def test_a_loss_that_speaks_of_jerk_is_told_apart_from_that_of_the_path() -> None:
    @dataclass(frozen=True)
    class Jerky:
        requires: ClassVar[tuple[str, ...]] = ("keypoints",)
        signs: ClassVar[tuple[str, ...]] = (JERK,)
        unit: ClassVar[str] = "frame"

        def residuals(self, reference: Features, rendered: Features) -> torch.Tensor:
            return torch.ones(len(rendered), 1)

    assert list(dict(directions(Objective({"mine": Jerky()}), filmed(), filmed()))) == ["jerk, mine"]


def test_a_loss_left_out_names_no_direction() -> None:
    assert tuple(ways(filmed(), "losses.framing=null")) == ("larger", *SIGNS[3:])


def test_metrics_that_weigh_movement_in_pixels_as_if_in_frame_widths_say_so(sweep_file: Callable[..., Path]) -> None:
    file = sweep_file("{as it is: {}}", "metrics: {output_side: 64, losses: {camera_movement: {mode: faithful}}}")
    (trial,) = trials(read_sweep(str(file)), {})
    assert "camera_movement counts" in run_trial(trial, Job()).note


def test_a_row_that_weighs_movement_in_pixels_as_if_in_frame_widths_says_so(sweep_file: Callable[..., Path]) -> None:
    file = sweep_file("{faithful: {output_side: 64, losses: {camera_movement: {mode: faithful}}}}")
    (trial,) = trials(read_sweep(str(file)), {})
    assert run_trial(trial, Job()).note.startswith("camera_movement counts 64 times what its tolerance asks for")


@pytest.mark.parametrize(("row", "told"), [("filmic_space: null", True), ("framing: null", False)])
def test_a_row_that_keeps_the_lens_besides_says_so(sweep_file: Callable[..., Path], row: str, told: bool) -> None:
    file = sweep_file(f"{{less: {{output_side: 64, losses: {{{row}}}}}}}")
    (trial,) = trials(read_sweep(str(file)), {})
    assert ("zoom=free lets it change" in run_trial(trial, Job()).note) == told


def test_a_term_that_is_measured_has_its_reason_and_is_no_note(sweep_file: Callable[..., Path]) -> None:
    (trial,) = trials(read_sweep(str(sweep_file("{alone: {frames: 1}}"))), {})
    outcome = run_trial(trial, Job())
    assert outcome.metrics is not None, outcome.failed
    assert outcome.metrics["camera_movement"].reason
    assert "camera_movement" not in outcome.note


def test_a_frame_of_nobody_pays_the_penalty_in_the_mean(
    sweep_file: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    found: list[Measured] = []

    def emptied(stage: Stage, cameras: Camera) -> Features:
        seen = read_path(stage, cameras)
        keypoints = seen.require("keypoints").clone()
        keypoints[1] = torch.nan
        return replace(seen, keypoints=keypoints)

    def kept(*arguments: Any) -> Measured:
        found.append(measured(*arguments))
        return found[0]

    monkeypatch.setattr("cltransfer.ablate.measure.read_path", emptied)
    monkeypatch.setattr("cltransfer.ablate.measure.measured", kept)
    (trial,) = trials(read_sweep(str(sweep_file("{full: {}}"))), {})
    outcome = run_trial(trial, Job())
    assert outcome.metrics is not None, outcome.failed
    raw = {term.name: term.values for term in found[0].scores.terms}
    for name in ("shot_size", "framing"):
        assert raw[name].isfinite().tolist() == [True, False]
        penalty = trial.metrics.build("losses")[name].penalty
        assert outcome.metrics[name].mean == pytest.approx((float(raw[name][0]) + penalty) / 2)


@pytest.mark.parametrize("late", ["reference", "render", ""])
def test_a_result_lasts_where_neither_side_may_be_told_better_by_another_run(late: str) -> None:
    sides = [replace(filmed(), reasons={"flow": OfThisRun("time ran out")} if late == side else {"flow": "it stands"})
             for side in ("reference", "render")]  # fmt: skip
    read = Reference(sides[0], torch.arange(2.0), None, "clip", "", "image", {})
    objective = Objective(load_config().build("losses"))
    assert _judged(objective, read, sides[1], math.nan).lasts is (late == "")


def test_both_sides_are_drawn_by_the_renderer_of_the_metrics_whatever_a_row_searched_by(
    sweep_file: Callable[..., Path],
) -> None:
    """Here by one that draws nothing that is as near as the person."""
    (trial,) = trials(read_sweep(str(sweep_file("{blind: {renderer: {gaussian_splats: {near: 99}}}}"))), {})
    outcome = run_trial(trial, Job())
    assert outcome.metrics is not None, outcome.failed
    assert (outcome.metrics["filmic_space"].defined, outcome.metrics["camera_movement"].defined) == (2, 1)
