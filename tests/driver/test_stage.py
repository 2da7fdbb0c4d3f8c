"""What a stage counts: an answer from the journal as much as one that was computed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.config import load_config
from cltransfer.driver.guard import Guard
from cltransfer.driver.journal import Journal, small_print
from cltransfer.driver.recent import Recent
from cltransfer.driver.stage import Spent, Stage, read_path
from cltransfer.errors import InputError, ModelError
from cltransfer.features import Features
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.objective import Objective
from cltransfer.pipeline.plan import Plan, Step
from cltransfer.scenes import Scene
from cltransfer.scenes.builtin import builtin_scene
from cltransfer.shots import shot

SIZE = (64, 36)


def test_beyond_a_view_that_is_blocked_there_is_nothing() -> None:
    scene = builtin_scene("courtyard")
    assert scene.subject is not None
    parts, cameras = Components.build(load_config()), shot("push_in", scene.subject, SIZE, 2).camera
    stage = Stage(scene, parts.renderer, parts.plan("scene"), Objective(parts.losses), SIZE)
    reference = read_path(stage, cameras)[:1]
    defined, seen = stage.objective.defined(reference)[0], stage.features(cameras[:1], None)
    for height, blocked in ((scene.subject.height, False), (100 * scene.subject.height, True)):
        guarded = replace(stage, guard=Guard(height))
        told = guarded.across(reference, seen, defined)
        assert bool((told.far == 0).all()) == blocked
        assert torch.equal(told.residuals, guarded.priced(reference, seen, defined))
        assert bool((told.beyond[0] == stage.objective.lost_residuals(defined)).all()) == blocked


@dataclass(frozen=True)
class TwoPasses:
    """A network that is asked twice a frame, and leaves the depth as it is."""

    requires: ClassVar[tuple[str, ...]] = ("depth",)
    provides: ClassVar[tuple[str, ...]] = ("depth",)
    passes: ClassVar[int] = 2

    def __call__(self, now: Features, before: Features | None = None) -> Features:
        return now


def test_a_replayed_answer_counts_its_renders_and_network_passes_like_a_computed_one(tmp_path: Path) -> None:
    scene = builtin_scene("courtyard")
    assert scene.subject is not None
    parts, cameras = Components.build(load_config()), shot("push_in", scene.subject, SIZE, 3).camera
    plan = parts.plan("scene")
    plan = replace(plan, steps=(*plan.steps, Step("two_passes", TwoPasses())))
    stage = Stage(scene, parts.renderer, plan, Objective(parts.losses), SIZE)
    reference = read_path(stage, cameras)[:1]
    defined, terms, spent = stage.objective.defined(reference)[0], [], []
    for resume in (False, True):
        journal = Journal(tmp_path / "j", {}, resume)
        asked = replace(stage, spent=Spent(), journal=journal)
        terms.append(asked.terms(reference, cameras, None))
        asked.residuals(reference, cameras[:2], None, defined)
        spent.append(asked.spent)
        assert journal.replayed == (2 if resume else 0)
    assert spent == [Spent(evaluations=5, renders=5, network_passes=10)] * 2
    assert torch.equal(terms[0].view(torch.int64), terms[1].view(torch.int64))


@dataclass(frozen=True)
class Unseen:
    """A renderer that nobody may ask."""

    def render(self, scene: Scene, cameras: Camera, buffers: frozenset[str]) -> Features:
        raise AssertionError("it was rendered")


def test_what_is_told_of_paths_is_answered_without_a_render_and_costs_the_same(tmp_path: Path) -> None:
    scene = builtin_scene("courtyard")
    assert scene.subject is not None
    parts, cameras = Components.build(load_config()), shot("orbit", scene.subject, SIZE, 5).camera
    stage = Stage(scene, parts.renderer, parts.plan("scene"), Objective(parts.losses), SIZE)
    reference = read_path(replace(stage, spent=Spent(), recent=Recent()), cameras)
    defined = stage.objective.defined(reference)
    told, spent = list[list[torch.Tensor]](), list[Spent]()
    for resume, renderer in ((False, parts.renderer), (True, Unseen())):
        asked = replace(
            stage, renderer=renderer, spent=Spent(), journal=Journal(tmp_path / "j", {}, resume), recent=Recent()
        )
        across = asked.path_across(reference, cameras, defined)
        before = list(asked.path(cameras[:3]))[-1]
        around = asked.view(cameras[[2, 4]], before)
        beyond = asked.told_across(reference[3], around, defined[3])
        told.append(
            [
                asked.path_residuals(reference, cameras[[0, 1, 3, 2, 4]], defined),
                asked.path_terms(reference, cameras, guarded=True),
                *(across.residuals, across.beyond, across.far),
                *(beyond.residuals, beyond.beyond, beyond.far),
                asked.told(reference[3], around, defined[3]),
            ]
        )
        spent.append(asked.spent)
    assert spent[0] == spent[1]
    assert spent[0].renders == 5 + 2 + 3  # the second path differs from the third frame on
    for computed, answered in zip(*told, strict=True):
        assert torch.equal(computed.view(torch.int64), answered.view(torch.int64))


def test_an_answer_of_other_columns_than_the_losses_have_is_refused(tmp_path: Path) -> None:
    """As of a journal that a stranger wrote."""
    scene = builtin_scene("courtyard")
    assert scene.subject is not None
    parts, cameras = Components.build(load_config()), shot("orbit", scene.subject, SIZE, 2).camera
    stage = Stage(scene, parts.renderer, parts.plan("scene"), Objective(parts.losses), SIZE)
    reference = read_path(stage, cameras)
    defined = stage.objective.defined(reference)
    asking: dict[str, Callable[[Stage], object]] = {
        "path terms": lambda asked: asked.path_terms(reference, cameras),
        "path residuals": lambda asked: asked.path_residuals(reference, cameras, defined),
        "path across": lambda asked: asked.path_across(reference, cameras, defined),
    }
    for kind, ask in asking.items():
        Journal(tmp_path / kind, {}, False).answer(cameras, lambda: torch.zeros(2, 2), small_print(reference, kind))
        with pytest.raises(InputError, match="record 1: answers another question"):
            ask(replace(stage, journal=Journal(tmp_path / kind, {}, True)))


@pytest.mark.parametrize("error", [RuntimeError("no paint"), SystemExit("no paint")])
def test_a_renderer_that_fails_or_ends_the_program_is_named(error: BaseException) -> None:
    @dataclass(frozen=True)
    class Brush:
        def render(self, scene: Scene, cameras: Camera, buffers: frozenset[str]) -> Features:
            raise error

    scene, parts = builtin_scene("courtyard"), Components.build(load_config())
    assert scene.subject is not None
    stage = Stage(scene, Brush(), parts.plan("scene"), Objective(parts.losses), SIZE)
    with pytest.raises(ModelError, match=r"renderer Brush: expected depth, label, it raised \w+: no paint"):
        stage.features(shot("static", scene.subject, SIZE, 1).camera, None)


@dataclass(frozen=True)
class TwoPeople:
    """A detector that sees a larger bystander at the left beside whoever stands in the middle."""

    requires: ClassVar[tuple[str, ...]] = ("image",)
    provides: ClassVar[tuple[str, ...]] = ("box",)

    def persons(self, now: Features) -> list[np.ndarray]:
        width, height = now.size
        filmed = [0.45 * width, 0.3 * height, 0.1 * width, 0.4 * height, 0.9]
        return [np.array([[0, 0, 0.4 * width, height, 0.9], filmed], np.float32) for _ in range(len(now))]

    def __call__(self, now: Features, before: Features | None) -> Features:
        return replace(now, box=torch.stack([torch.from_numpy(found[0]) for found in self.persons(now)]))


@dataclass(frozen=True)
class MiddleOfBox:
    requires: ClassVar[tuple[str, ...]] = ("box",)
    provides: ClassVar[tuple[str, ...]] = ("keypoints",)

    def __call__(self, now: Features, before: Features | None) -> Features:
        box = now.require("box")
        middle = torch.stack([box[:, 0] + box[:, 2] / 2, box[:, 1] + box[:, 3] / 2, box[:, 4]], dim=1)
        return replace(now, keypoints=middle[:, None].expand(-1, 14, 3).clone())


@pytest.mark.parametrize(("people", "share"), [(2, 0.5), (1, 0.2)])
def test_networks_in_the_loop_read_who_is_filmed_and_not_the_largest(people: int, share: float) -> None:
    """Of one person, as before, whom the detector takes for the main one."""
    scene, parts = builtin_scene("courtyard"), Components.build(load_config())
    assert scene.subject is not None
    scene = replace(scene, subject=replace(scene.subject, people=people))
    steps = (Step("detector", TwoPeople()), Step("reader", MiddleOfBox()))
    plan = Plan(steps, frozenset({"image", "depth", "label", "alpha"}), frozenset({"keypoints"}), {})
    camera = Camera.look_at(
        (scene.subject.anchor + 3 * scene.subject.height * scene.subject.facing)[None],
        scene.subject.anchor, scene.up, 0.7, SIZE,
    )  # fmt: skip
    seen = Stage(scene, parts.renderer, plan, Objective(parts.losses), SIZE).features(camera, None)
    assert seen.require("keypoints")[0, 0, 0].item() == pytest.approx(share * SIZE[0])
