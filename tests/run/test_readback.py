"""Frames of a video are counted before any is rendered."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from cltransfer.bench.synthetic_room import room_cameras
from cltransfer.computer import memory
from cltransfer.config import load_config
from cltransfer.driver.recent import Recent
from cltransfer.driver.stage import Stage, read_path
from cltransfer.errors import ResourceError
from cltransfer.features import Features
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.objective import Objective
from cltransfer.pipeline.scores import score
from cltransfer.reading.reference import Reference
from cltransfer.registry import LOSSES
from cltransfer.run import readback
from cltransfer.run.kept_reading import Read
from cltransfer.run.readback import RENDER_BATCH, Readback, check_frames, check_result, read_held, render_frames
from cltransfer.scenes.load import load_scene
from cltransfer.shots import shot


@dataclass(frozen=True)
class MeanDepth:
    """How much farther everything is."""

    weight: float = 1.0
    requires, unit, penalty = ("depth",), "m", 1.0

    def __call__(self, reference: Features, rendered: Features) -> torch.Tensor:
        return (reference.require("depth") - rendered.require("depth")).abs().mean((1, 2))


PALETTE = """from dataclasses import dataclass
from cltransfer import LOSSES

@LOSSES.register("palette")
@dataclass(frozen=True)
class Palette:
    weight: float = 4.0
    requires, uses = ("image",), ("keypoints",)
    unit, penalty = "of 1", 1.0

    def __call__(self, reference, rendered):
        return (rendered.require("image").mean((2, 3)) - reference.require("image").mean((2, 3))).norm(dim=1)
"""
HINT = r"lower output_side or frames\)$"


class Counting:
    """Draws frame k of its life in grey k / 255, and keeps how many were asked for."""

    def __init__(self) -> None:
        self.batches: list[int] = []

    def render(self, scene: Any, cameras: Any, buffers: frozenset[str]) -> Any:
        first = sum(self.batches)
        self.batches.append(len(cameras))
        grey = torch.arange(first, first + len(cameras)) / 255
        image = grey[:, None, None, None].expand(-1, 3, *cameras.size[::-1])
        return Features(cameras.size, image=image, camera=cameras, person=scene.subject)


def rendered(count: int, renderer: Counting) -> torch.Tensor:
    scene: Any = SimpleNamespace(subject=None)
    return render_frames(scene, Components(renderer, {}, {}), room_cameras(count, (8, 6)))


def test_all_frames_are_rendered_in_turn_a_batch_at_a_time() -> None:
    renderer = Counting()
    image = rendered(RENDER_BATCH + 3, renderer)
    assert (image.shape, image.dtype) == ((RENDER_BATCH + 3, 3, 6, 8), torch.uint8)
    assert image[:, 0, 0, 0].tolist() == list(range(RENDER_BATCH + 3))
    assert renderer.batches == [RENDER_BATCH, 3]


def test_frames_that_do_not_fit_are_refused_before_one_is_rendered(monkeypatch: pytest.MonkeyPatch) -> None:
    renderer = Counting()
    monkeypatch.setattr(readback, "BYTE_LIMIT", 3 * 5 * 8 * 6 - 1)
    with pytest.raises(ResourceError, match=rf"^frames: 5 of 8x6 need 720 bytes, the limit is 719 \({HINT}"):
        rendered(5, renderer)
    monkeypatch.setattr(memory, "free_bytes", lambda: 2 * 2**20)
    monkeypatch.setattr(readback, "BYTE_LIMIT", 2**32)
    with pytest.raises(ResourceError, match=rf"memory: 10 frames of 1000x100 need 3 MB, 2 MB are free .*{HINT}"):
        check_frames(10, (1000, 100))
    monkeypatch.setattr(memory, "free_bytes", lambda: 20 * 2**20)
    check_frames(10, (1000, 100))
    with pytest.raises(ResourceError, match=rf"the maps of 10 frames of 1000x100 need 57 MB, 20 MB are free .*{HINT}"):
        check_result(10, (1000, 100))
    assert renderer.batches == []


@pytest.mark.parametrize("size", [(4096, 2304), (2976, 2976), (3000, 2949)])
def test_frames_larger_than_can_be_read_again_are_refused(size: tuple[int, int]) -> None:
    told = f"^frames: expected at most 8847360 pixels each, got {size[0]}x{size[1]} .lower output_side.$"
    with pytest.raises(ResourceError, match=told):
        check_frames(1, size)
    check_frames(1, (4096, 2160))


def test_a_transfer_says_so_before_it_searches(command: Any, tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(readback, "BYTE_LIMIT", 1000)
    said = command("transfer", "-q", "--out", tmp_path / "run", "frames=2", "search_side=48", "output_side=96")
    assert said.code == 5
    assert "frames: 2 of 96x54 need 31104 bytes, the limit is 1000 (lower output_side or frames)" in said.err


@pytest.mark.parametrize("asks", ["requires", "uses"])
def test_a_loss_that_asks_for_pixels_sees_those_of_the_result(asks: str, command: Any, tmp_path: Any) -> None:
    """A plugin's, of a scene that teaches a scene; its name is forgotten with the process."""
    (tmp_path / "palette.py").write_text(
        PALETTE.replace("requires, uses", "uses, requires") if asks == "uses" else PALETTE
    )
    small = ("preset=fast", "frames=2", "search_side=48", "output_side=64", "losses.palette={}", "--json", "-q")
    said = command("transfer", "--allow-plugin", tmp_path / "palette.py", "--out", tmp_path / "run", *small)
    LOSSES._classes.pop("palette", None)
    assert said.code == 0, said.err
    found = json.loads((tmp_path / "run" / "metrics.json").read_text())["metrics"]["palette"]
    assert (found["defined"], found["reason"]) == (2, "")
    assert 0 < found["mean"] < 0.5


def test_a_view_that_is_held_is_not_compared_where_depth_is_read_off_the_movement() -> None:
    config = load_config(
        overrides=["extractors.depth_sfm={}", "extractors.detect_yolox=null", "extractors.pose_blazepose=null"]
    )
    scene, parts = load_scene("builtin:plaza"), Components.build(config)
    assert scene.subject is not None
    parts = replace(parts, losses={"depth": MeanDepth()})
    cameras = shot("push_in", scene.subject, (96, 54), 5).camera
    features = Features((96, 54), depth=torch.ones(5, 54, 96))  # as one that moves would be read
    reference = Reference(features, torch.arange(5), None, "clip.mp4", "", "image", {})
    objective = Objective(parts.losses)
    stage = Stage(scene, parts.renderer, parts.plan("scene"), objective, (48, 27))
    shown = Readback(
        render_frames(scene, parts, cameras), Read.of(features, score(objective, features, features, {})), reference
    )
    assert read_held(stage, parts, shown, cameras) is None


@pytest.mark.parametrize("frames", [1, 5])
def test_a_view_that_is_held_is_rendered_twice_and_scored_for_every_frame(frames: int) -> None:
    scene, parts = load_scene("builtin:plaza"), Components.build(load_config())
    assert scene.subject is not None
    cameras = shot("push_in", scene.subject, (96, 54), frames).camera
    stage = Stage(scene, parts.renderer, parts.plan("scene"), Objective(parts.losses), (48, 27))
    own = replace(stage, size=(96, 54))
    features = read_path(own, cameras)
    reference = Reference(features, torch.arange(frames), None, "plaza", "", "scene", {})
    scores = score(stage.objective, features, features, {})
    shown = Readback(torch.zeros(frames, 3, 54, 96, dtype=torch.uint8), Read.of(features, scores), reference)
    before = stage.spent.renders
    held = read_held(replace(stage, recent=Recent()), parts, shown, cameras)
    assert stage.spent.renders - before == min(2, frames)
    every = score(stage.objective, features, read_path(own, cameras[[0] * frames]), {})
    torch.testing.assert_close(held.totals, every.totals, rtol=0, atol=0, equal_nan=True)
