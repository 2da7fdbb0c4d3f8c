"""Views that were seen last: the same features, not rendered again."""

from __future__ import annotations

import weakref
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar

import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.config import load_config
from cltransfer.driver.guard import Guard
from cltransfer.driver.journal import Journal
from cltransfer.driver.recent import MOST, PIXELS, Context, Recent
from cltransfer.driver.stage import AHEAD, Spent, Stage, read_path
from cltransfer.features import Features
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.objective import Objective
from cltransfer.pipeline.plan import Step
from cltransfer.scenes.builtin import builtin_scene
from cltransfer.shots import shot

SIZE = (64, 36)
FRAMES = AHEAD + 2


@pytest.fixture
def stage() -> Stage:
    scene, parts = builtin_scene("courtyard"), Components.build(load_config())
    return Stage(scene, parts.renderer, parts.plan("scene"), Objective(parts.losses), SIZE)


@pytest.fixture
def cameras(stage: Stage) -> Camera:
    assert stage.scene.subject is not None
    return shot("push_in", stage.scene.subject, SIZE, FRAMES).camera


def same(a: Features, b: Features) -> None:
    assert a.names() == b.names()
    for name in a.names() - {"camera", "person"}:
        assert torch.equal(torch.nan_to_num(a.require(name).double()), torch.nan_to_num(b.require(name).double())), name


def test_a_candidate_that_is_settled_on_is_not_rendered_again_and_looks_as_if_it_were(
    stage: Stage, cameras: Camera
) -> None:
    before = stage.view(cameras[0], None)
    reference = read_path(replace(stage, recent=Recent()), cameras)
    stage.terms(reference[1], cameras[1:4], before)
    rendered = stage.spent.renders
    found = stage.view(cameras[2], before)
    assert stage.spent.renders == rendered
    assert found is stage.view(cameras[2], before)  # so that the next frame's are found again too
    same(found.features, replace(stage, recent=Recent()).features(cameras[2], before))


@pytest.mark.parametrize("what", ["camera", "before", "size", "scene", "renderer", "guard"])
def test_anything_else_is_rendered(stage: Stage, cameras: Camera, what: str) -> None:
    before = stage.view(cameras[0], None)
    stage.features(cameras[1], before)
    rendered = stage.spent.renders
    another = replace(stage, recent=Recent(), spent=Spent()).view(cameras[0], None)
    other = {
        "camera": lambda: stage.features(cameras[2], before),
        "before": lambda: stage.features(cameras[1], another),
        "size": lambda: replace(stage, size=(32, 18)).features(cameras[1], before),
        "scene": lambda: replace(stage, scene=replace(stage.scene)).features(cameras[1], before),
        "renderer": lambda: replace(stage, renderer=replace(stage.renderer)).features(cameras[1], before),
        "guard": lambda: replace(stage, guard=Guard(None)).features(cameras[1], before),
    }
    other[what]()
    assert stage.spent.renders == rendered + 1


def test_a_path_is_that_of_its_frames_one_by_one_and_is_rendered_once(stage: Stage, cameras: Camera) -> None:
    path = list(stage.path(cameras))
    assert stage.spent.renders == FRAMES
    again = list(stage.path(cameras))
    assert stage.spent.renders == FRAMES
    assert all(one is two for one, two in zip(path, again, strict=True))
    alone, before = replace(stage, recent=Recent(pixels=0)), None
    for i in range(FRAMES):
        before = alone.view(cameras[i], before)
        same(path[i].features, before.features)


def test_a_path_that_leaves_a_known_one_is_rendered_from_there(stage: Stage, cameras: Camera) -> None:
    list(stage.path(cameras))
    turned = cameras[[0, 1, 4, 3]]
    seen = list(stage.path(turned))
    assert stage.spent.renders == FRAMES + 2
    for one, two in zip(seen, replace(stage, recent=Recent()).path(turned), strict=True):
        same(one.features, two.features)


def test_a_camera_that_stands_is_rendered_three_times_and_looks_as_if_it_were_rendered_always(
    stage: Stage, cameras: Camera
) -> None:
    still = cameras[[0] * FRAMES]
    path = list(stage.path(still))
    assert stage.spent.renders == 3  # without a frame before, with one, and to see that nothing changes any more
    assert all(frame is path[1] for frame in path[2:])
    alone, before = replace(stage, recent=Recent(pixels=0)), None
    for frame in path:
        before = replace(alone).view(still[0], None if before is None else replace(before))
        same(frame.features, before.features)


def test_a_camera_that_stops_and_goes_on_is_rendered_wherever_it_moves(stage: Stage, cameras: Camera) -> None:
    stops = cameras[[0, 1, 2, 2, 2, 2, 2, 3, 4]]
    path = list(stage.path(stops))
    assert stage.spent.renders == 3 + 2 + 2
    alone = replace(stage, recent=Recent(pixels=0))
    for one, two in zip(path, alone.path(stops), strict=True):
        same(one.features, two.features)


def test_of_a_path_that_stops_no_more_is_held_than_of_one_that_moves(stage: Stage, cameras: Camera) -> None:
    held = list[int]()

    @dataclass(frozen=True)
    class Watched:
        """A plugin that keeps track of the frames that are in memory."""

        requires: ClassVar[tuple[str, ...]] = ("depth",)
        provides: ClassVar[tuple[str, ...]] = ("frame",)
        frames: list[weakref.ref[torch.Tensor]] = field(default_factory=list)

        def __call__(self, now: Features, before: Features | None = None) -> Features:
            frame = torch.ones(len(now))
            self.frames.append(weakref.ref(frame))
            held.append(sum(one() is not None for one in self.frames))
            return now.having("frame", frame)

    watched = replace(stage, plan=replace(stage.plan, steps=(*stage.plan.steps, Step("watched", Watched()))))
    watched = replace(watched, recent=Recent(pixels=2 * SIZE[0] * SIZE[1]))
    stops = cameras[[*range(FRAMES), FRAMES - 1, FRAMES - 1]]
    reference = read_path(replace(stage, recent=Recent()), stops)
    watched.path_terms(reference, stops)
    assert len(held) == FRAMES + 2
    assert max(held) <= 4  # two that are remembered, the one before, and this one


def test_a_frame_that_turns_out_to_be_known_hands_on_no_other_ones_view(stage: Stage, cameras: Camera) -> None:
    """The second path stands longer than the first, which went on from there: its fourth frame was rendered ahead."""
    list(stage.path(cameras[[0, 0, 1, 2, 3]]))
    stands = cameras[[0, 0, 0, 1, 4, 5]]
    for i, (one, two) in enumerate(zip(stage.path(stands), replace(stage, recent=Recent()).path(stands), strict=True)):
        assert one.features.camera is not None
        assert torch.equal(one.features.camera.w2c, stands[i].w2c)
        same(one.features, two.features)


@dataclass(frozen=True)
class HasOneBefore:
    """A plugin that compares with the frame before: whether there is one."""

    requires: ClassVar[tuple[str, ...]] = ("depth",)
    provides: ClassVar[tuple[str, ...]] = ("one",)
    needs_before: ClassVar[bool] = True

    def __call__(self, now: Features, before: Features | None) -> Features:
        return now.having("one", torch.ones(len(now)))


@dataclass(frozen=True)
class HadOneBefore:
    """Another that compares what that one gave: whether the frame before had one before it."""

    requires: ClassVar[tuple[str, ...]] = ("one",)
    provides: ClassVar[tuple[str, ...]] = ("two",)
    needs_before: ClassVar[bool] = True

    def __call__(self, now: Features, before: Features | None) -> Features:
        assert before is not None
        return now.having("two", before.require("one").nan_to_num(0.0).expand(len(now)))


def test_a_camera_that_stands_is_rendered_until_nothing_changes_any_more(stage: Stage, cameras: Camera) -> None:
    steps = (*stage.plan.steps, Step("one", HasOneBefore()), Step("two", HadOneBefore()))
    plan = replace(stage.plan, steps=steps)
    path = replace(stage, plan=plan).path(cameras[[0] * 6])
    assert [float(frame.features.require("two")) for frame in path][1:] == [0, 1, 1, 1, 1]
    assert stage.spent.renders == 4


def test_the_oldest_are_forgotten_first_and_what_is_too_much_at_once_is_not_kept(stage: Stage, cameras: Camera) -> None:
    recent = Recent(pixels=3 * SIZE[0] * SIZE[1])
    stage = replace(stage, recent=recent)
    context = Context(stage.scene, stage.renderer, stage.plan, False, SIZE, None)
    stage.features(cameras[:2], None)
    stage.features(cameras[2:4], None)
    assert [recent.find(context, cameras[i]) is not None for i in range(4)] == [False, False, True, True]
    stage.features(cameras[4:8], None)
    assert [recent.find(context, cameras[i]) is not None for i in range(2, 8)] == [True, True] + 4 * [False]


def test_what_a_journal_answered_is_seen_in_the_batch_it_was_part_of(
    stage: Stage, cameras: Camera, tmp_path: Path
) -> None:
    reference, found, spent = read_path(stage, cameras)[0], list[Features](), list[Spent]()
    for resume in (False, True):
        asked = replace(stage, spent=Spent(), journal=Journal(tmp_path / "j", {}, resume), recent=Recent())
        asked.terms(reference, cameras[:3], None)
        found.append(asked.features(cameras[1], None))
        asked.terms(reference, cameras[1], None)  # known: not counted as a render by either
        spent.append(asked.spent)
    same(*found)
    assert spent == [Spent(evaluations=4, renders=3)] * 2


def test_a_camera_that_stands_is_counted_alike_when_a_journal_answers(
    stage: Stage, cameras: Camera, tmp_path: Path
) -> None:
    reference, spent = read_path(stage, cameras)[0], list[Spent]()
    for resume in (False, True):
        asked = replace(stage, spent=Spent(), journal=Journal(tmp_path / "j", {}, resume), recent=Recent())
        before = None
        for _ in range(6):
            asked.terms(reference, cameras[0], before)
            before = asked.view(cameras[0], before)
        spent.append(asked.spent)
    assert spent == [Spent(evaluations=3, renders=3)] * 2


def test_a_path_too_long_for_the_least_room_is_rendered_once_however_often_it_is_walked(
    stage: Stage, cameras: Camera, monkeypatch: pytest.MonkeyPatch
) -> None:
    least = (FRAMES - 1) * SIZE[0] * SIZE[1]
    monkeypatch.setattr("cltransfer.driver.recent.PIXELS", least)
    for recent, again in ((Recent(pixels=least), FRAMES), (Recent.of(FRAMES, SIZE), 0)):
        walked = replace(stage, recent=recent, spent=Spent())
        read_path(walked, cameras)
        read_path(walked, cameras)
        assert walked.spent.renders == FRAMES + again


def test_there_is_room_for_a_path_or_for_no_more_than_for_a_short_one() -> None:
    """What is not enough for a path helps no walk along it."""
    size = (160, 90)
    frames = range(1, 1001)
    rooms = [Recent.of(count, size).pixels for count in frames]
    whole = [count for count, room in zip(frames, rooms) if room > PIXELS]
    assert (whole[0], whole[-1]) == (84, 444)
    assert all(1.25 * count * 160 * 90 <= rooms[count - 1] <= MOST for count in whole)
    assert {room for count, room in zip(frames, rooms) if count not in whole} == {PIXELS}
