"""Rounds: what one of them tells the next."""

import math
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.config import load_config
from cltransfer.driver.closed_form import Guide
from cltransfer.driver.stage import Stage, read_path
from cltransfer.driver.starts import Starts
from cltransfer.driver.whole_clip import WholeClip
from cltransfer.features import Features
from cltransfer.progress import silent
from cltransfer.run import rounds
from cltransfer.run.correct import Bias
from cltransfer.run.inputs import Inputs
from cltransfer.run.preparation import Clock, Job, prepare
from cltransfer.run.rounds import MAY_HIDE, Round, _guide, _least_lost, attempts
from cltransfer.run.take import Take

FRAMES = 3
LOST = 2  # frame in which things hide some joints


@pytest.mark.parametrize("off", [0.0, 0.02])  # that the round before was aimed off by, and its guide
def test_a_frame_that_was_not_reached_is_as_high_in_the_next_round_as_it_was_read_less_the_bias(off: float) -> None:
    x = torch.rand(FRAMES, 7, dtype=torch.float64)
    read = Guide(x - 5, torch.tensor([0.1, 0.2, 0.3], dtype=torch.float64) - off)
    take: Any = SimpleNamespace(clip=SimpleNamespace(about=lambda home, path: path + 1), x=x, guide=read)
    nothing: Any = None
    now = Round(take, nothing, nothing, torch.full((FRAMES,), off, dtype=torch.float64))
    angles = torch.zeros(FRAMES, 3, dtype=torch.float64)
    angles[:, 1] = torch.tensor([0.0, 0.05, -0.05], dtype=torch.float64)
    found = _guide(now, nothing, Bias(torch.zeros(FRAMES, 14, 2), angles))
    torch.testing.assert_close(found.x, x + 1)
    torch.testing.assert_close(found.pitch, torch.tensor([0.1, 0.15, 0.35], dtype=torch.float64))


@dataclass(frozen=True)
class Reading:
    """What networks read of a round: how much too high [rad], how it scores, and whether they lost the person."""

    high: float
    total: float = 1.0
    lost: bool = False


@dataclass(frozen=True)
class Given:
    """What a round was given, and how much lower than in the reference its target and its guide are [rad]."""

    by: Job
    stage: Stage
    homes: Camera
    lower: tuple[float, float]
    before: Take | None
    found: Take

    @property
    def watchful(self) -> bool:
        """Whether it takes no view in which things hide many joints."""
        assert self.stage.guard is not None
        assert self.stage.guard == self.by.stage.guard
        return self.stage.guard.hidden == MAY_HIDE


@pytest.fixture(scope="module")
def read_by_networks() -> Job:
    """A push in as if networks had read it, to be taught to the plaza in up to four rounds."""
    small = ["frames=6", "search_side=48", "output_side=48", "threads=1", "floaters=keep"]
    config = load_config(overrides=["preset=fast", *small, "extract.verify=false", "extract.corrections=3"])
    job = prepare(Inputs("builtin:plaza", "builtin:push_in"), config, Clock(), silent, None)
    schedule = replace(job.schedule, basin=math.inf, rescue=math.inf)
    return replace(job, reference=replace(job.reference, family="image"), by_networks=True, schedule=schedule)


def without_person(features: Features) -> Features:
    """Such ``features`` with nobody in one frame."""
    keypoints = features.require("keypoints").clone()
    keypoints[LOST, :, :2] = math.nan
    return features.having("keypoints", keypoints)


def rounds_of(job: Job, readings: list[Reading], monkeypatch: pytest.MonkeyPatch) -> list[Given]:
    """What each round is given where every search finds the guide of the first, and networks read it so."""
    first, given, left = job.starts.guide, list[Given](), iter(readings)
    assert first is not None
    seen = read_path(job.stage, job.search.cameras(first.x, job.starts.homes[0], job.stage.scene.subject))
    keypoints, pitch = seen.require("keypoints").clone(), job.wanted.require("orientation")[:, 1]
    keypoints[LOST, :5, 2] = 0.0  # behind something

    def search_path(
        by: Job, stage: Stage, target: Features, starts: Starts, report: Any, before: Take | None = None
    ) -> Take:
        guide = starts.guide
        assert guide is not None
        lower = (pitch - target.require("orientation")[:, 1], first.pitch - guide.pitch)
        clip = WholeClip(stage, by.search, target, starts.homes[0], by.starting.at)
        found: Any = SimpleNamespace(x=first.x, camera=clip.cameras(first.x))
        take = Take(clip, found, None, guide)
        lowered = (float(lower[0].mean()), float(lower[1].mean()))
        given.append(Given(by, stage, starts.homes, lowered, before, take))
        return take

    def read_back(stage: Stage, parts: Any, reference: Any, *rest: Any) -> Any:
        reading = next(left)
        shown = seen.having("orientation", seen.require("orientation") + torch.tensor([0.0, reading.high, 0.0]))
        shown = without_person(shown) if reading.lost else shown
        return SimpleNamespace(features=shown, reference=reference, scores=SimpleNamespace(total=reading.total))

    monkeypatch.setattr(rounds, "search_path", search_path)
    monkeypatch.setattr(rounds, "read_back", read_back)
    monkeypatch.setattr(rounds, "read_path", lambda stage, cameras: seen.having("keypoints", keypoints))
    attempts(job, Clock(), silent)
    return given


def test_each_round_is_aimed_off_the_bias_of_the_one_before_alone(
    read_by_networks: Job, monkeypatch: pytest.MonkeyPatch
) -> None:
    readings = [Reading(0.05), Reading(0.02), Reading(-0.03), Reading(0.0)]
    given = rounds_of(read_by_networks, readings, monkeypatch)
    for one, off in zip(given, [0.0, 0.05, 0.02, -0.03], strict=True):
        assert one.lower == pytest.approx((off, off))
        assert one.by is read_by_networks
        assert not one.watchful
    assert [one.before for one in given] == [None, *(one.found for one in given[:-1])]


@pytest.mark.parametrize(("total", "of_use"), [(0.5, True), (1.0, False), (1.5, False)])
def test_a_watchful_round_starts_from_the_reference_and_is_gone_on_from_where_it_was_of_use(
    total: float, of_use: bool, read_by_networks: Job, monkeypatch: pytest.MonkeyPatch
) -> None:
    readings = [Reading(0.05, 2.0), Reading(0.03, 1.0, lost=True), Reading(0.02, total), Reading(0.0)]
    given = rounds_of(read_by_networks, readings, monkeypatch)
    for one, off in zip(given, [0.0, 0.05, 0.0, 0.02 if of_use else 0.03], strict=True):
        assert one.lower == pytest.approx((off, off))
    assert [one.watchful for one in given] == [False, False, True, of_use]
    first, second, third, _ = (one.found for one in given)
    assert [one.before for one in given] == [None, first, None, third if of_use else second]


def test_a_watchful_round_looks_for_a_view_where_a_frame_costs_a_quarter_of_what_none_costs(
    read_by_networks: Job, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, watchful = rounds_of(read_by_networks, [Reading(0.0, lost=True), Reading(0.05)] * 2, monkeypatch)[:2]
    assert (first.by.schedule.basin, first.by.schedule.rescue) == (math.inf, math.inf)
    none = _least_lost(read_by_networks)
    assert 0 < none < math.inf
    assert (watchful.by.schedule.basin, watchful.by.schedule.rescue) == pytest.approx((none / 4, none / 4))


def test_who_is_not_in_the_reference_is_not_lost(read_by_networks: Job, monkeypatch: pytest.MonkeyPatch) -> None:
    reference = replace(read_by_networks.reference, features=without_person(read_by_networks.reference.features))
    job = replace(read_by_networks, reference=reference)
    given = rounds_of(job, [Reading(0.05, lost=True)] * 4, monkeypatch)
    assert [one.watchful for one in given] == [False] * 4


@pytest.mark.parametrize("warm", [True, False])
def test_where_every_frame_starts_anew_a_later_round_starts_where_the_first_did_too(
    warm: bool, read_by_networks: Job, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = replace(read_by_networks, config=replace(read_by_networks.config, warm_start=warm))
    first, second = rounds_of(job, [Reading(0.05)] * 4, monkeypatch)[:2]
    assert len(second.homes) == (1 if warm else 1 + len(first.homes))
