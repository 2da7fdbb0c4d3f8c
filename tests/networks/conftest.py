"""Networks in the loop: tiny ones with YOLOX's and BlazePose's shapes, and scenes whose people they can read.

They read paint: the left of a person is red and the right is magenta, of a second person green and cyan, and everything
else is grey. So they are never unsure, but they are no oracle: what they read is off by a bias, as real ones are.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import pytest
import torch
from torch import Tensor, nn

from cltransfer.config import load_config
from cltransfer.pipeline.components import Components
from cltransfer.run.readback import render_frames
from cltransfer.scenes import Scene
from cltransfer.scenes.builtin import named_scene
from cltransfer.scenes.columns import SH0
from cltransfer.scenes.person.lifted import save_labels
from cltransfer.scenes.ply import write_splats
from cltransfer.shots import shot

PAINTS = torch.tensor([[[1.0, 0, 0], [1, 0, 1]], [[0, 1, 0], [0, 1, 1]]])  # left and right of either person
LEVELS = {7: 0.065, 8: 0.065, 11: 0.185, 12: 0.185, 13: 0.37, 14: 0.37, 15: 0.5, 16: 0.5, 23: 0.47, 24: 0.47}
LEVELS |= {25: 0.715, 26: 0.715, 27: 0.955, 28: 0.955, 33: 0.5, 34: 0.0}  # of BlazePose's landmarks, head top to feet
LEFT, RIGHT = (7, 11, 13, 15, 23, 25, 27), (8, 12, 14, 16, 24, 26, 28)


def extent(mask: Tensor, axis: int) -> tuple[Tensor, Tensor]:
    """First and last edge (B, 1) of what is true in ``mask`` (B, 1, H, W) along x (axis 3) or y (axis 2) [px]."""
    any_there = mask.amax((1, 5 - axis))  # (B, H or W)
    place, far = torch.arange(mask.shape[axis]).float(), float(mask.shape[axis])
    first = (place + (1 - any_there) * far).amin(1, keepdim=True)
    return first, ((place + 1) * any_there).amax(1, keepdim=True)


class Detector(nn.Module):
    """YOLOX: a box about what is red and one about what is green, each in a cell of stride 32 at the top left.

    Args:
        slender: only one that is at least so many times as tall as wide.
    """

    def __init__(self, slender: float = 0.0) -> None:
        super().__init__()
        self.slender = slender

    def forward(self, images: Tensor) -> Tensor:
        paint = (images[:, 2:] - images[:, 1:2]) / 255  # BGR
        rows = [self.row((sign * paint > 0.5).float(), cell) for cell, sign in enumerate((1, -1))]
        rest = torch.zeros(1, 3547, 85).expand(images.shape[0], 3547, 85)
        return torch.cat([rest[:, :3380], torch.stack(rows, 1), rest[:, 3380:]], 1)

    def row(self, mask: Tensor, cell: int) -> Tensor:
        (left, right), (top, bottom) = extent(mask, 3), extent(mask, 2)
        size = torch.cat([right - left, bottom - top], 1).clamp_min(1) / 32
        place = torch.cat([(left + right) / 64 - cell, (top + bottom) / 64], 1)
        there = mask.amax((1, 2, 3))[:, None] * (size[:, 1:] >= self.slender * size[:, :1])
        return torch.cat([place, size.log(), there, torch.ones_like(there), torch.zeros(1, 79) * there], 1)


class Body(nn.Module):
    """BlazePose: who has more paint in the crop; the left joints in the middle of the left half, at usual heights."""

    def __init__(self) -> None:
        super().__init__()
        level, side = torch.full((39,), 0.5), torch.zeros(39)
        level[list(LEVELS)] = torch.tensor([*LEVELS.values()])
        side[list(LEFT)], side[list(RIGHT)] = 1.0, -1.0
        self.register_buffer("level", level)
        self.register_buffer("side", side)

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        paint = image[:, :1] - image[:, 1:2]
        red, green = (paint > 0.5).float(), (paint < -0.5).float()
        mask = torch.where(red.sum((1, 2, 3), keepdim=True) > green.sum((1, 2, 3), keepdim=True), red, green)
        right = mask * (image[:, 2:] > 0.5).float()
        (first, last), (top, bottom) = extent(mask, 3), extent(mask, 2)
        masses, middles = zip(*(self.middle(half, (first + last) / 2) for half in (mask - right, right)))
        turned = (masses[0] - masses[1]) / (masses[0] + masses[1] + 1e-6)
        on_left, on_right = (self.side > 0).float(), (self.side < 0).float()
        x = on_left * middles[0] + on_right * middles[1] + (1 - on_left - on_right) * (first + last) / 2
        y = top + self.level * (bottom - top)
        share = (on_left * masses[0] + on_right * masses[1]) / (masses[0] + masses[1] + 1e-6)
        seen = (share - 0.03) * 200
        across = (middles[0] - middles[1]) / (0.12 * (bottom - top).clamp_min(1))
        world = torch.stack([self.side * across, (self.level - 0.5) * torch.ones_like(x), -self.side * turned], 2)
        landmarks = torch.stack([x, y, 0 * x, seen, seen], 2)
        return landmarks.flatten(1), mask.amax((1, 2, 3))[:, None], mask * 20 - 10, world.flatten(1)

    def middle(self, mask: Tensor, otherwise: Tensor) -> tuple[Tensor, Tensor]:
        """How much there is of ``mask`` (B, 1) [px], and its middle (B, 1)."""
        mass = mask.sum((1, 2, 3))[:, None]
        x = (mask.sum((1, 2)) * (torch.arange(mask.shape[3]) + 0.5)).sum(1, keepdim=True)
        return mass, torch.where(mass > 0, x / mass.clamp_min(1), otherwise)


@pytest.fixture(scope="session")
def planted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of both networks."""
    folder = tmp_path_factory.mktemp("planted")

    def save(net: nn.Module, name: str, key: str, side: int, *outputs: str) -> None:
        free = {one: {0: "batch"} for one in (key, *outputs)}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            torch.onnx.export(
                net.eval(), (torch.rand(1, 3, side, side),), str(folder / name), input_names=[key],
                output_names=list(outputs), dynamic_axes=free, opset_version=17, dynamo=False,
            )  # fmt: skip

    save(Detector(), "detector.onnx", "images", 416, "output")
    save(Detector(slender=1.8), "whole.onnx", "images", 416, "output")
    save(Body(), "body.onnx", "input", 256, "output0", "output1", "output2", "output4")
    return folder


@pytest.fixture
def networks(planted: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[str, ...]:
    """Overrides by which a config's networks are the planted ones."""
    monkeypatch.setenv("CLTRANSFER_MODELS", str(planted))
    return ("extractors.detect_yolox.model=detector.onnx", "extractors.pose_blazepose.model=body.onnx")


def painted(scene: Scene, person: int = 0) -> Scene:
    """A scene of splats in grey, its person in the networks' paint."""
    splats, subject = scene.geometry, scene.subject
    assert subject is not None
    grey = splats.sh.mean(2, keepdim=True).expand(-1, -1, 3).clone()
    left = (splats.means.double() - subject.anchor) @ subject.left > 0
    paint = torch.where(left[:, None], *PAINTS[person])
    own = splats.label > 0.5
    grey[own] = 0
    grey[own, 0] = (paint[own] - 0.5) / SH0
    return replace(scene, geometry=replace(splats, sh=grey))


@pytest.fixture(scope="session")
def stage() -> Scene:
    """The built-in stage, painted."""
    return painted(named_scene("stage"))


@pytest.fixture(scope="session")
def scene_file(stage: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The painted stage as a file that marks nobody, and beside it its person with labels."""
    folder = tmp_path_factory.mktemp("stage")
    assert stage.subject is not None
    write_splats(folder / "stage.ply", stage.geometry)
    save_labels(folder, stage.geometry.label)
    stage.subject.save(folder / "subject.json")
    return folder / "stage.ply"


@pytest.fixture(scope="session")
def film(stage: Scene, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Make a folder of images of a shot in the painted stage."""

    def make(name: str, frames: int) -> Path:
        folder = tmp_path_factory.mktemp(name) / name
        folder.mkdir()
        assert stage.subject is not None
        path = shot(name, stage.subject, (240, 136), frames)
        images = render_frames(stage, Components.build(load_config()), path.camera)
        for number, image in enumerate(images):
            assert cv2.imwrite(str(folder / f"{number:02d}.png"), image.permute(1, 2, 0).flip(-1).numpy())
        return folder

    return make
