"""What a row is told of: the path that was taken."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from cltransfer.bench import trial as plain
from cltransfer.bench.protocol import Trial
from cltransfer.bench.stress import trial as stressed
from cltransfer.bench.stress.case import Film
from cltransfer.config_options import RunConfig
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
