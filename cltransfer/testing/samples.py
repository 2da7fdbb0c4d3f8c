"""Features of made-up frames with a plausible person, layers and flow."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import interpolate

from ..camera import Camera
from ..feature_shapes import SHAPES
from ..features import Features
from ..subject import Subject

PERSON_FEATURES = frozenset({"keypoints", "box", "subject", "orientation"})
SIZE = (64, 36)  # (W, H) [px] of sample features

_JOINTS = (  # a standing body of height 1, facing +y, z up: half width, then height
    (0.11, 0.82), (-0.11, 0.82), (0.15, 0.63), (-0.15, 0.63), (0.16, 0.48), (-0.16, 0.48),
    (0.06, 0.53), (-0.06, 0.53), (0.06, 0.28), (-0.06, 0.28), (0.06, 0.04), (-0.06, 0.04),
    (0.0, 1.0), (0.0, 0.84),
)  # fmt: skip


def sample_subject() -> Subject:
    """A standing person 1.7 units high at the origin, facing +y, with +z up."""
    joints = torch.tensor([[-x, 0.0, z] for x, z in _JOINTS], dtype=torch.float64) * 1.7
    axes = torch.eye(3, dtype=torch.float64)
    return Subject(joints, torch.full((14,), 0.9, dtype=torch.float64), axes[1], axes[2], 1.7)


def sample_cameras(seed: int, batch: int, size: tuple[int, int] = SIZE) -> Camera:
    """Cameras about four units in front of :func:`sample_subject`, all of it in the frame."""
    random = torch.Generator().manual_seed(seed)
    shake = torch.rand(batch, 3, generator=random, dtype=torch.float64) - 0.5
    eye = torch.tensor([0.0, 4.0, 1.2], dtype=torch.float64) + shake
    target = torch.tensor([0.0, 0.0, 0.85], dtype=torch.float64) + 0.2 * shake.flip(1)
    return Camera.look_at(eye, target, torch.tensor([0.0, 0.0, 1.0]), math.radians(40), size)


def sample_features(seed: int, batch: int) -> Features:
    """Every feature of ``batch`` frames: a person before a wall, on a floor, a post nearer than the person.

    Flow is affine in each layer; all layers are there and the whole person is seen.
    """
    random = torch.Generator().manual_seed(seed)
    camera, person = sample_cameras(seed, batch), sample_subject()
    pixels, ahead = camera.project(person.joints)
    confidence = (0.6 + 0.4 * torch.rand(batch, 14, 1, generator=random)).double()
    low, high = pixels.amin(1), pixels.amax(1)
    x, y = pixel_centres(camera.size)
    middle, radius = (low + high)[:, :, None, None] / 2, (high - low)[:, :, None, None] / 2
    subject = ((x - middle[:, 0]) / (radius[:, 0] + 2)) ** 2 + ((y - middle[:, 1]) / (radius[:, 1] + 1)) ** 2 <= 1
    post = ~subject & (x < 0.1 * camera.size[0])
    layers = torch.stack([post, subject, ~subject & ~post], dim=1)
    near = ahead.mean(1)[:, None, None] + 0.02 * (x - middle[:, 0]) / camera.size[0]
    wall = near * (2.5 - y / camera.size[1])
    depth = torch.where(subject, near, torch.where(post, near * (0.4 + 0.001 * x), wall)).float()
    return Features(
        camera.size,
        image=_smooth(torch.rand(batch, 3, *x.shape, generator=random)),
        alpha=torch.ones_like(depth),
        label=subject.float(),
        depth=depth,
        expected_depth=depth.clone(),
        keypoints=torch.cat([pixels, confidence], dim=-1),
        box=torch.cat([low, high - low, torch.ones(batch, 1)], dim=-1),
        subject=subject,
        layers=layers,
        flow=_layered_flow(layers, random),
        orientation=torch.rand(batch, 3, generator=random) - 0.5,
        camera=camera,
        person=person,
    )


def without_person(features: Features) -> Features:
    """The same frames with nobody in them."""
    nan = float("nan")
    gone: dict[str, Any] = {
        "label": torch.zeros_like(features.require("label")),
        "subject": torch.zeros_like(features.require("subject")),
        **{name: torch.full_like(features.require(name), nan) for name in ("keypoints", "box", "orientation")},
    }
    layers = features.require("layers").clone()
    layers[:, 2] |= layers[:, 1]
    layers[:, 1] = False
    return dataclasses.replace(features, **gone, layers=layers)


def twice_as_large(features: Features) -> Features:
    """The same frames of twice the width and height, maps too; all that is in pixels is doubled.

    Extras of a value for each pixel of the frame, (B, ..., H, W), are maps too; others stay as they are.
    """
    width, height = (2 * side for side in features.size)
    maps = features.names() & {name for name, shape in SHAPES.items() if shape[-2:] == (None, None)}
    changed: dict[str, Any] = {name: _repeated(features.require(name)) for name in maps}
    shape = (features.size[1], features.size[0])
    extras = {n: _repeated(v) if v.shape[1:][-2:] == shape else v for n, v in features.extras.items()}
    for name, columns in (("keypoints", 2), ("box", 4)):
        if features.has(name):
            values = features.require(name)
            changed[name] = torch.cat([2 * values[..., :columns], values[..., columns:]], dim=-1)
    if "flow" in changed:
        changed["flow"] = 2 * changed["flow"]
    if features.camera is not None:
        changed["camera"] = features.camera.at_size((width, height))
    return dataclasses.replace(features, size=(width, height), extras=extras, **changed)


def _repeated(maps: Tensor) -> Tensor:
    return maps.repeat_interleave(2, -1).repeat_interleave(2, -2)


def _smooth(noise: Tensor) -> Tensor:
    """Every eighth pixel of ``noise`` (B, 3, H, W) and what lies between: it resizes as a photograph does."""
    return interpolate(noise[..., ::8, ::8], noise.shape[-2:], mode="bilinear")


def pixel_centres(size: tuple[int, int]) -> tuple[Tensor, Tensor]:
    """Pixel centres x and y of a frame of ``size``, each (H, W) [px]."""
    y, x = torch.meshgrid(torch.arange(size[1]) + 0.5, torch.arange(size[0]) + 0.5, indexing="ij")
    return x, y


def _layered_flow(layers: Tensor, random: torch.Generator) -> Tensor:
    height, width = layers.shape[-2:]
    x, y = pixel_centres((width, height))
    basis = torch.stack([torch.ones_like(x), x / width - 0.5, y / height - 0.5])
    fields = torch.randn(len(layers), 3, 2, 3, generator=random) @ basis.flatten(1)  # (B, 3, 2, H * W)
    return (fields.unflatten(-1, (height, width)) * layers[:, :, None]).sum(1)
