"""What networks read of a path: told by the journal to the bit, and nothing else believed."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from cltransfer.config import load_config
from cltransfer.driver.journal import Journal
from cltransfer.driver.stage import Stage
from cltransfer.errors import InputError
from cltransfer.features import Features, OfThisRun
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.objective import Objective
from cltransfer.pipeline.scores import score
from cltransfer.run.kept_reading import Read, kept_reading
from cltransfer.scenes.load import load_scene
from cltransfer.testing.samples import sample_cameras, sample_features

FRAMES = 3


@pytest.fixture(scope="module")
def objective() -> Objective:
    return Objective(Components.build(load_config()).losses)


@pytest.fixture
def read(objective: Objective) -> Read:
    """Of a clip in whose second frame nobody is seen, and whose depth nobody could tell."""
    seen = replace(sample_features(1, FRAMES), depth=None, camera=None, reasons={"depth": OfThisRun("nothing moves")})
    assert seen.keypoints is not None
    points = seen.keypoints.clone()
    points[1] = torch.nan
    seen = replace(seen, keypoints=points.float())
    return Read.of(seen, score(objective, sample_features(2, FRAMES), seen, {}))


def stage(objective: Objective, path: Path, resume: bool) -> Stage:
    scene, parts = load_scene("builtin:courtyard"), Components.build(load_config())
    return Stage(scene, parts.renderer, parts.plan("scene"), objective, (32, 18), journal=Journal(path, {}, resume))


def same(one: Read, two: Read) -> None:
    assert one.names == two.names
    assert one.features.names() == two.features.names()
    assert (one.features.size, dict(one.features.reasons)) == (two.features.size, dict(two.features.reasons))
    for name in one.features.names():
        a, b = one.features.require(name), two.features.require(name)
        assert a.dtype == b.dtype
        torch.testing.assert_close(a, b, rtol=0, atol=0, equal_nan=True)
    assert [(t.name, t.unit, t.weight, t.reason) for t in one.scores.terms] == [
        (t.name, t.unit, t.weight, t.reason) for t in two.scores.terms
    ]
    for a, b in zip([*one.scores.terms], [*two.scores.terms]):
        torch.testing.assert_close(a.values, b.values, rtol=0, atol=0, equal_nan=True)
    torch.testing.assert_close(one.scores.totals, two.scores.totals, rtol=0, atol=0, equal_nan=True)


def test_what_was_read_is_told_to_the_bit_and_nobody_looks_again(
    objective: Objective, read: Read, tmp_path: Path
) -> None:
    cameras = sample_cameras(4, FRAMES)
    assert "the render has no 'depth': nothing moves" in [term.reason for term in read.scores.terms]
    first = kept_reading(stage(objective, tmp_path / "j", False), cameras, lambda: read)
    same(first, read)
    resumed = stage(objective, tmp_path / "j", True)
    same(kept_reading(resumed, cameras, lambda: pytest.fail("it was read again")), read)
    assert resumed.journal is not None
    assert resumed.journal.replayed == 1


def test_of_frames_in_which_nobody_was_looked_for_their_number_is_told(objective: Objective) -> None:
    bare = Features((8, 6), flow=torch.zeros(FRAMES, 2, 6, 8))
    read = Read.of(bare, score(objective, sample_features(2, FRAMES), bare, {}))
    told = Read.from_json(json.loads(json.dumps(read.to_json())), objective, FRAMES)
    assert len(told.features) == FRAMES
    same(told, read)
    with pytest.raises(ValueError, match="expected 4 frames"):
        Read.from_json(read.to_json(), objective, FRAMES + 1)


@pytest.mark.parametrize(
    "change",
    [
        lambda told: told.pop("size"),
        lambda told: told.update(size=[4]),
        lambda told: told.update(reasons=[1]),
        lambda told: told["terms"].pop(),
        lambda told: told["terms"].__setitem__(0, ["a", ""]),
        lambda told: told["totals"].pop(),
        lambda told: told["places"]["box"].update(values=[[1.0]]),
        lambda told: told["places"]["box"].update(type="object"),
        lambda told: told.update(totals=[1.0]),
        lambda told: told.update(size=[float("inf"), 4]),
        lambda told: [places.update(values=places["values"][1:]) for places in told["places"].values()],
    ],
)
def test_a_document_that_says_something_else_is_refused(
    objective: Objective, read: Read, tmp_path: Path, change: Callable[[dict[str, Any]], object]
) -> None:
    cameras, told = sample_cameras(4, FRAMES), copy.deepcopy(read.to_json())
    change(told)
    Journal(tmp_path / "j", {}, False).document(cameras, lambda: told)
    with pytest.raises(InputError, match="reading: is damaged"):
        kept_reading(stage(objective, tmp_path / "j", True), cameras, lambda: read)


@pytest.mark.parametrize("kind", [torch.float16, torch.bfloat16, torch.float64])
def test_joints_of_any_float_come_back_as_they_were(objective: Objective, read: Read, kind: torch.dtype) -> None:
    points = read.features.require("keypoints").to(kind)
    given = replace(read, features=replace(read.features, keypoints=points))
    same(Read.from_json(json.loads(json.dumps(given.to_json())), objective, FRAMES), given)


@pytest.mark.parametrize("told", [[], "read", 3, None])
def test_so_is_one_that_is_no_object(objective: Objective, read: Read, tmp_path: Path, told: object) -> None:
    cameras = sample_cameras(4, FRAMES)
    Journal(tmp_path / "j", {}, False).document(cameras, lambda: told)
    with pytest.raises(InputError, match="reading: is damaged"):
        kept_reading(stage(objective, tmp_path / "j", True), cameras, lambda: read)


def test_a_document_is_no_answer_and_an_answer_no_document(tmp_path: Path) -> None:
    cameras, other = sample_cameras(4, FRAMES), sample_cameras(5, FRAMES)
    Journal(tmp_path / "d", {}, False).document(cameras, dict)
    Journal(tmp_path / "a", {}, False).answer(cameras, lambda: cameras.center)
    asks: list[tuple[str, Callable[[Journal], object]]] = [
        ("d", lambda journal: journal.answer(cameras, lambda: cameras.center)),
        ("d", lambda journal: journal.document(other, dict)),
        ("a", lambda journal: journal.document(cameras, dict)),
    ]
    for name, ask in asks:
        with pytest.raises(InputError, match="record 1: answers another question"):
            ask(Journal(tmp_path / name, {}, True))
