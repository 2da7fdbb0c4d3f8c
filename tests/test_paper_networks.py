"""The config of the paper's five networks, run from clip to scores on tiny networks with the published interfaces."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from torch import Tensor, nn

from cltransfer.config import load_config
from cltransfer.models.catalogue import catalogue
from cltransfer.pipeline.components import Components

CONFIG = Path(__file__).resolve().parents[1] / "configs" / "networks" / "paper.yaml"
SIZE = (320, 180)
MEAN, STD = torch.tensor([0.485, 0.456, 0.406])[:, None, None], torch.tensor([0.229, 0.224, 0.225])[:, None, None]
LOSSES = ("shot_size", "framing", "filmic_space", "camera_movement", "camera_angle")


def redness(image: Tensor) -> Tensor:
    """How red (B, 1, H, W) an image (B, 3, H, W) in [0, 1] is."""
    return (image[:, :1] - image[:, 1:].mean(1, keepdim=True)).clamp_min(0)


def middle(red: Tensor) -> Tensor:
    """Middle of the red (B, 2) as x, y [px, corner at 0]."""
    y, x = torch.arange(red.shape[2]) + 0.5, torch.arange(red.shape[3]) + 0.5
    mass = red.sum((1, 2, 3)) + 1e-6
    return torch.stack([(red.sum((1, 2)) * x).sum(1) / mass, (red.sum((1, 3)) * y).sum(1) / mass], 1)


class Segmenter(nn.Module):
    """A person of 120 x 240 px about the middle of the red; its mask is the red."""

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor]:
        red = redness(images)
        box = torch.cat([middle(red), torch.tensor([[120.0, 240.0]]).expand(images.shape[0], 2)], 1)
        score = red.amax((1, 2, 3))[:, None]
        rest = torch.zeros(images.shape[0], 111)
        column = torch.cat([box, score, torch.zeros_like(rest[:, :79]), torch.ones_like(score), rest[:, :31]], 1)
        others = torch.zeros(1, 116, 8399).expand(images.shape[0], 116, 8399)
        masks = nn.functional.avg_pool2d(red, 4) * 20 - 10
        return torch.cat([column[:, :, None], others], 2), masks.repeat(1, 32, 1, 1)


class Pose(nn.Module):
    """14 Gaussians in a standing body's places about the middle of the red."""

    def __init__(self) -> None:
        super().__init__()
        half, height = torch.tensor([4.0, 4, 5, 5, 6, 6, 2, 2, 2, 2, 2, 2, 0, 0]), torch.linspace(-12, 20, 12)
        x = half * torch.tensor([1.0, -1] * 7)
        self.register_buffer("places", torch.stack([x, torch.cat([height, torch.tensor([-22.0, -15])])], 1))

    def forward(self, image: Tensor) -> Tensor:
        center = middle(redness(image * STD + MEAN)) / 4 - 0.125
        x, y = torch.arange(48.0), torch.arange(64.0)[:, None]
        at = (center[:, None] + self.places)[..., None, None]
        return torch.exp(-((x - at[:, :, 0]) ** 2 + (y - at[:, :, 1]) ** 2) / 8)


class Disparity(nn.Module):
    """The red is twice as near as the rest."""

    def forward(self, pixel_values: Tensor) -> Tensor:
        return 1 + (redness(pixel_values * STD + MEAN)[:, 0] > 0.3).float()


class Flow(nn.Module):
    """How far the middle of the red went, everywhere."""

    def forward(self, image1: Tensor, image2: Tensor) -> Tensor:
        shift = middle(redness(image2 / 255)) - middle(redness(image1 / 255))
        return shift[:, :, None, None] + 0 * image1[:, :2]


class Orientation(nn.Module):
    """The azimuth is the brightest green of the crop, in degrees, of 100."""

    def forward(self, pixel_values: Tensor) -> Tensor:
        green = (pixel_values * STD + MEAN)[:, 1].amax((1, 2))[:, None] * 100
        azimuth = -((torch.arange(360.0) - green) ** 2)
        level = -((torch.arange(180.0) - 90) ** 2).expand(green.shape[0], 180)
        sure = torch.tensor([[5.0, 0.0]]).expand(green.shape[0], 2)
        return torch.cat([azimuth, level, level, sure], 1)


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("models")

    def save(net: nn.Module, name: str, shapes: dict[str, tuple[int, ...]], *outputs: str) -> None:
        images = tuple(torch.rand(shape, generator=torch.Generator().manual_seed(0)) for shape in shapes.values())
        free = {key: {0: "batch"} for key in (*shapes, *outputs)}
        if name.startswith("depth"):
            free = {key: {0: "batch", 2: "height", 3: "width"} for key in shapes} | {outputs[0]: {0: "batch"}}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            torch.onnx.export(
                net.eval(), images, str(folder / name), input_names=list(shapes), output_names=list(outputs),
                dynamic_axes=free, opset_version=17, dynamo=False,
            )  # fmt: skip

    save(Segmenter(), "yolov8n_seg.onnx", {"images": (1, 3, 640, 640)}, "output0", "output1")
    save(Pose(), "hrnet_w32_crowdpose.onnx", {"input": (1, 3, 256, 192)}, "output")
    save(Disparity(), "depth_anything_v2_small.onnx", {"pixel_values": (1, 3, 518, 924)}, "predicted_depth")
    save(Flow(), "raft_large.onnx", {"image1": (1, 3, 432, 768), "image2": (1, 3, 432, 768)}, "flow")
    save(Orientation(), "orient_anything_large.onnx", {"pixel_values": (1, 3, 224, 224)}, "logits")
    return folder


def clip(folder: Path, starts: float, steps: float, green: int = 0) -> Path:
    """Three frames of a red man of 50 x 100 px who goes to the right by ``steps`` px a frame."""
    folder.mkdir()
    for number in range(3):
        frame = np.full((SIZE[1], SIZE[0], 3), 100, np.uint8)
        left = int(starts + steps * number)
        frame[40:140, left : left + 50] = (0, green, 255)  # BGR
        cv2.imwrite(str(folder / f"{number:03d}.png"), frame)
    return folder


def test_every_network_of_the_config_is_in_the_catalogue_and_all_losses_are_fed() -> None:
    config = load_config(CONFIG)
    files = {entry.file for entry in catalogue("model").values()}
    assert {options["model"] for options in config.extractors.values() if "model" in (options or {})} <= files
    plan = Components.build(config).plan("image")
    assert plan.missing == {}
    names = [step.name for step in plan.steps]
    assert sorted(names) == ["depth_onnx", "flow_raft", "layers", "orient_anything", "pose_topdown", "segment_yolo"]
    assert plan.passes == 6  # the flow is checked the other way round


def scores(command: Callable[..., Any], reference: Path, render: Path) -> dict[str, Any]:
    answer = command("evaluate", reference, render, "--config", CONFIG, "--json", "--quiet")
    assert answer.code == 0, answer.err
    return json.loads(answer.out)["metrics"]


def test_clips_are_scored_by_the_five_networks(command, models, tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("CLTRANSFER_MODELS", str(models))
    first = clip(tmp_path / "first", 60, 8)
    other = clip(tmp_path / "other", 92, 4, green=77)
    same = scores(command, first, first)
    assert {name: same[name]["mean"] for name in LOSSES} == dict.fromkeys(LOSSES, pytest.approx(0, abs=1e-6))
    assert {name: same[name]["defined"] for name in LOSSES} == {**dict.fromkeys(LOSSES, 3), "camera_movement": 2}
    apart = scores(command, first, other)
    assert apart["framing"]["mean"] == pytest.approx((32 + 28 + 24) / 3 / SIZE[0], abs=0.003)
    assert apart["camera_movement"]["mean"] == pytest.approx(4 / SIZE[0], abs=0.001)
    assert apart["camera_angle"]["mean"] == pytest.approx(np.radians(30), abs=0.02)
    assert apart["shot_size"]["mean"] == pytest.approx(0, abs=0.01)
