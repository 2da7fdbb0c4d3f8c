"""Movement of a render is taken in its reference's steps, and so is all that is read from it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import pytest
import torch
from torch import Tensor

from cltransfer.clips.clip import write_video
from cltransfer.clips.pairs import pairs
from cltransfer.config import load_config
from cltransfer.evaluate import OWN_STEPS, evaluate
from cltransfer.features import Features
from cltransfer.pipeline.graph import run_clip
from cltransfer.pipeline.plan import CLIP_SOURCE, Plan, make_plan
from cltransfer.reading.in_time import InTime, in_other_steps, in_time, own_steps
from cltransfer.registry import EXTRACTORS, LOSSES

EQUAL, SLOWER = torch.full((2,), 0.04), torch.tensor([0.04, 0.08])


@dataclass(frozen=True)
class Still:
    """A flow of one pixel to the right."""

    family: ClassVar[str] = "image"
    requires: ClassVar[tuple[str, ...]] = ("image",)
    provides: ClassVar[tuple[str, ...]] = ("flow",)

    def __call__(self, now: Features, before: Features | None) -> Features:
        flow = torch.zeros(len(now), 2, *now.require("image").shape[2:])
        flow[:, 0] = 1.0
        return now.having("flow", flow)


@dataclass(frozen=True)
class Speed:
    """Mean of the flow to the right."""

    family: ClassVar[str] = "image"
    requires: ClassVar[tuple[str, ...]] = ("flow",)
    provides: ClassVar[tuple[str, ...]] = ("speed",)

    def __call__(self, now: Features, before: Features | None) -> Features:
        return now.having("speed", now.require("flow")[:, 0].mean((1, 2)))


@dataclass(frozen=True)
class Brighter:
    """By how much a frame is brighter than the one before."""

    family: ClassVar[str] = "image"
    requires: ClassVar[tuple[str, ...]] = ("image",)
    provides: ClassVar[tuple[str, ...]] = ("brighter",)
    needs_before: ClassVar[bool] = True

    def __call__(self, now: Features, before: Features | None) -> Features:
        assert before is not None
        return now.having("brighter", (now.require("image") - before.require("image")).mean((1, 2, 3)))


@dataclass(frozen=True)
class Twice:
    """Twice that."""

    family: ClassVar[str] = "image"
    requires: ClassVar[tuple[str, ...]] = ("brighter",)
    provides: ClassVar[tuple[str, ...]] = ("twice",)

    def __call__(self, now: Features, before: Features | None) -> Features:
        return now.having("twice", 2 * now.require("brighter"))


@dataclass(frozen=True)
class Sum:
    """Of all that a clip has of a feature, in every frame; of a flow by its largest component."""

    requires: tuple[str, ...] = ("speed",)
    provides: tuple[str, ...] = ("sum",)

    family: ClassVar[str] = "image"
    whole_clip: ClassVar[bool] = True

    def read_clip(self, found: Features, load: Callable[[int, int], Features]) -> Features:
        rows = found.require(self.requires[0]).reshape(len(found), -1).amax(1)
        return found.having(self.provides[0], rows.nansum().expand(len(found)))


@dataclass(frozen=True)
class Differs:
    """Of a feature, by its absolute difference."""

    of: str = "speed"
    weight: float = 1.0

    unit: ClassVar[str] = "px"
    penalty: ClassVar[float] = 1.0

    @property
    def requires(self) -> tuple[str, ...]:
        return (self.of,)

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        return (rendered.require(self.of) - reference.require(self.of)).abs()


ALL = {
    "still": Still(),
    "speed": Speed(),
    "brighter": Brighter(),
    "twice": Twice(),
    "sum": Sum(),
    "path": Sum(("flow",), ("path",)),
    "bright": Sum(("brighter",), ("bright",)),
}


def plan(*wanted: str) -> Plan:
    return make_plan(frozenset(wanted), ALL, CLIP_SOURCE, "image")


def test_what_is_read_from_flow_is_read_from_that_of_the_reference_s_steps() -> None:
    def load(start: int, stop: int) -> Features:
        return Features((4, 3), image=torch.rand(stop - start, 3, 3, 4))

    steps = in_time(plan("speed", "brighter"), EQUAL, SLOWER)
    assert [step.name for step in steps.steps] == ["brighter", "still", "in_time", "speed"]
    found = run_clip(steps, load, 3)
    assert found.require("speed").tolist() == [1.0, 1.0, 0.5]
    assert in_time(plan("brighter"), EQUAL, SLOWER) == plan("brighter")
    assert in_time(plan("speed"), EQUAL, EQUAL + 0.001) == plan("speed")  # by which times are rounded


def test_a_reader_of_whole_clips_has_what_others_read_from_the_flow_of_the_reference_s_steps() -> None:
    found = run_clip(
        in_time(plan("sum"), EQUAL, SLOWER), lambda a, b: Features((4, 3), image=torch.rand(b - a, 3, 3, 4)), 3
    )
    assert found.require("sum").tolist() == [2.5] * 3


def rate(frames: float, tick: float | None = None) -> Tensor:
    """Times of half a second of a clip of so many frames a second, kept in ticks [s]."""
    times = torch.arange(round(frames / 2), dtype=torch.float64) / frames
    return times if tick is None else (times / tick).round() * tick


@pytest.mark.parametrize(
    ("original", "shown", "other"),
    [
        (rate(240), rate(200), True),  # steps of 4.2 ms and 5 ms
        (rate(165), rate(144, 1 / 90000), True),
        (rate(240), rate(240, 1 / 90000), False),
        (rate(240), rate(240, 0.001), False),  # 4 and 5 ms for 4.2
        (rate(240, 0.001), rate(240, 1 / 90000), False),
        (rate(30), rate(29.97, 1 / 90000), False),
    ],
)
def test_steps_of_high_rates_are_told_apart_as_far_as_their_times_tell(
    original: Tensor, shown: Tensor, other: bool
) -> None:
    first, second = pairs(original, shown)
    steps = original[first].diff(), shown[second].diff()
    assert in_other_steps(*steps) == other
    share = in_time(plan("speed"), *steps).steps[-2].extractor
    taken = share.share[1:] if isinstance(share, InTime) else torch.ones(len(steps[0]))
    torch.testing.assert_close(taken, steps[0] / steps[1] if other else torch.ones_like(taken))


def test_what_compares_two_frames_and_is_no_flow_is_in_nobody_s_time() -> None:
    losses = {name: Differs(name) for name in ("speed", "brighter", "twice")}
    assert own_steps(plan("speed", "twice"), losses) == ["brighter", "twice"]
    losses = {name: Differs(name) for name in ("sum", "path", "bright")}
    assert own_steps(plan("sum", "path", "bright"), losses) == ["path", "bright"]  # a sum is of flow in time
    assert (in_other_steps(EQUAL, SLOWER), in_other_steps(EQUAL, EQUAL + 0.001)) == (True, False)


@pytest.fixture
def overrides() -> Iterator[list[str]]:
    for name in ("speed", "brighter"):
        EXTRACTORS.register(name)(type(ALL[name]))
    LOSSES.register("differs")(Differs)
    shipped = load_config()
    yield [
        *(f"losses.{name}=null" for name in shipped.losses),
        *(f"extractors.{name}=null" for name in shipped.extractors if name != "flow_dis"),
        *("extractors.speed={}", "extractors.brighter={}"),
    ]
    for name in ("speed", "brighter"):
        EXTRACTORS._classes.pop(name)
    LOSSES._classes.pop("differs")


def panned(path: Path, rate: float) -> str:
    """A second of a camera that pans by 40 pixels a second over a blotchy wall."""
    coarse = torch.rand(1, 3, 9, 20, generator=torch.Generator().manual_seed(1))
    wall = torch.nn.functional.interpolate(coarse, (48, 400), mode="bicubic")[0].clamp(0, 1)
    times = torch.arange(round(rate) + 1).double() / rate
    at = [round(float(t) * 160) for t in times]
    image = torch.stack([wall[:, :, x : x + 224].reshape(3, 48, 56, 4).mean(3) for x in at])
    write_video(path, image.mul(255).byte(), times, lossless=True)
    return str(path)


def test_clips_of_two_rates_are_scored_in_the_steps_of_one(tmp_path: Path, overrides: list[str]) -> None:
    reference, render = panned(tmp_path / "a.mkv", 20), panned(tmp_path / "b.mkv", 8)
    report = evaluate(reference, render, load_config(overrides=[*overrides, "losses.differs={}"]))
    assert report.scores.terms[0].mean < 0.1  # [px] of 2
    assert not any(OWN_STEPS in note for note in report.notes)
    brighter = load_config(overrides=[*overrides, "losses.differs.of=brighter"])
    assert f"differs: {OWN_STEPS}" in evaluate(reference, render, brighter).notes
    assert not any(OWN_STEPS in note for note in evaluate(reference, reference, brighter).notes)
