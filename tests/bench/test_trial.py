"""What a row is told of: the path that was taken, priced where it lacks what the reference has."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from cltransfer.bench import trial as plain
from cltransfer.bench import warm_up as warming
from cltransfer.bench.failure import LEAST_ALPHA
from cltransfer.bench.judge import HELD_OUT
from cltransfer.bench.protocol import SIZE, Trial
from cltransfer.bench.stress import trial as stressed
from cltransfer.bench.stress.case import Film
from cltransfer.camera import Camera
from cltransfer.config.options import RunConfig
from cltransfer.registry import LOSSES
from cltransfer.trajectory import Trajectory
from cltransfer.transfer import Inputs, Result, transfer

SMALL = ("search_side=64",)


def bound_as_found(inputs: Inputs, config: RunConfig) -> Result:
    """A transfer of which a frame was found at its bound, and the path taken is not."""
    result = transfer(inputs, config)
    assert result.kept.path is not None
    x = result.kept.found.x.clone()
    x[1, 3] = result.search.bounds()[1][3]
    kept = replace(result.kept, found=replace(result.kept.found, x=x))
    return replace(result, attempts=(*result.attempts[: result.best], kept, *result.attempts[result.best + 1 :]))


def test_a_frame_is_at_its_bound_where_the_path_taken_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plain, "transfer", bound_as_found)
    trial = Trial("fast", "pan", "plaza-2000", "plaza-2000", 1000, 2, SMALL)
    clip, shots = plain.Clip.drawn(trial), tmp_path / "shots.json"
    clip.reference.save(shots)
    assert plain._taken(trial, clip, shots).pinned.tolist() == [False, False]


def test_under_stress_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stressed, "transfer", bound_as_found)
    trial = stressed.StressTrial("fast", "", 0, "push_in", "plaza-2", "room-3", 1, 2, SMALL)
    clip = stressed._drawn(trial.clip, Film(2, stressed.SIZE))
    assert stressed._taken(trial, clip, clip.case)[1].tolist() == [False, False]


def test_who_loses_the_person_pays_in_a_held_out_reading_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(HELD_OUT, "joints", ("losses.camera_movement=null", "losses.filmic_space=null"))
    trial = Trial("fast", "push_in", "plaza-2000", "plaza-2000", 1000, 2)
    clip = plain.Clip.drawn(trial)
    eye, scene = clip.true.camera.center, clip.pupil
    away = Camera.look_at(eye, 2 * eye - scene.person.anchor, scene.up, 0.7, SIZE)
    take = plain.Take(Trajectory(away, clip.true.times), torch.zeros(2, dtype=torch.bool), {})
    read = plain._held_out(clip, take, trial, "joints")
    for name in ("shot_size", "framing"):
        assert read[name] == [LOSSES.build(name).penalty] * 2


@pytest.mark.slow  # a grid is baked
def test_the_true_cameras_do_not_fail_where_the_scene_has_no_sky() -> None:
    trial = Trial("fast", "push_in", "stage-200000", "path-200001-grid", 1000, 2)
    clip = plain.Clip.drawn(trial)
    take = plain.Take(clip.true, torch.zeros(2, dtype=torch.bool), {})
    assert float(plain.Reader.of(trial.pupil).cover(clip.pupil, clip.true.camera).max()) < LEAST_ALPHA
    assert plain._judged(trial, clip, take)["failed"] == {}


@pytest.mark.slow  # tests/bench/test_rows.py has processes too
def test_a_process_is_warm_before_it_is_timed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    heard: list[tuple[str, str]] = []

    def told(who: str) -> Callable[[Inputs, RunConfig], Result]:
        def run(inputs: Inputs, config: RunConfig) -> Result:
            heard.append((who, str(inputs.scene)))
            return transfer(inputs, config)

        return run

    monkeypatch.setattr(plain, "transfer", told("timed"))
    monkeypatch.setattr(warming, "transfer", told("warming up"))
    warming._warmed.cache_clear()
    for pupil in ("plaza-2000", "path-2001"):
        plain.run_trial(Trial("fast", "static", "plaza-2000", pupil, 1000, 2, SMALL), pupil, tmp_path)
    warmed = [("warming up", "builtin:room-0")] * len(warming.BOTH_ENGINES)
    assert heard == [*warmed, ("timed", "builtin:plaza-2000"), ("timed", "builtin:path-2001")]


@pytest.mark.parametrize(
    ("scene", "drawn_by"),
    [("builtin:courtyard", "room-0"), ("plaza-2-mesh", "room-0-mesh"), ("plaza-2-grid", "room-0-grid")],
)
def test_what_is_warm_draws_scenes_of_that_form(scene: str, drawn_by: str, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []
    monkeypatch.setattr(warming, "_warmed", asked.append)
    warming.warm_up(scene)
    assert asked == [drawn_by]
