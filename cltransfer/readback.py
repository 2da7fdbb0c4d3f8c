"""Reading back what was found: frames rendered, read by networks or by geometry, scored against the reference."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from .camera import Camera
from .components import Components
from .driver.follow import still
from .driver.stage import Stage
from .features import Features
from .progress import Progress, silent
from .read_frames import render_features
from .reference import Reference, quantised
from .scenes import Scene
from .scores import Scores, score

RENDER_BATCH = 8  # frames of a video rendered together


@dataclass(frozen=True)
class Readback:
    """A path as its reference would be read.

    Args:
        image: the rendered frames, (N, 3, H, W) uint8, as they are kept.
        features: what the extractors saw in them.
        scores: against the reference.
    """

    image: Tensor  # (N, 3, H, W) uint8
    features: Features
    scores: Scores


def render_frames(scene: Scene, parts: Components, cameras: Camera, progress: Progress = silent) -> Tensor:
    """Frames (N, 3, H, W) uint8 of N cameras."""
    frames = []
    for start in range(0, len(cameras), RENDER_BATCH):
        part = parts.renderer.render(scene, cameras[start : start + RENDER_BATCH], frozenset({"image"}))
        frames.append(quantised(part.image))
        progress("rendering", min(start + RENDER_BATCH, len(cameras)), len(cameras))
    return torch.cat(frames)


def read_back(
    stage: Stage,
    parts: Components,
    reference: Reference,
    cameras: Camera,
    by_networks: bool,
    progress: Progress = silent,
) -> Readback:
    """Render a path at its own size and score it by networks (on the frames as kept) or by the stage's extractors."""
    image = render_frames(stage.scene, parts, cameras, progress)
    stage.spent.renders += len(image)
    if by_networks:
        plan = parts.plan("image", reference.features.names())
        features = render_features(image, cameras, stage.scene.subject, plan)
        stage.spent.network_passes += len(image) * plan.passes
    else:
        features = read_path(replace(stage, size=cameras.size), cameras)
    return Readback(image, features, score(stage.objective, reference.features, features, reference.missing))


def read_held(stage: Stage, parts: Components, reference: Reference, shown: Readback, cameras: Camera) -> Scores:
    """Scores of the first view held still for the whole clip: what a transfer has to beat."""
    if shown.features.has("camera"):
        features = read_path(replace(stage, size=cameras.size), still(cameras, len(cameras)))
    else:
        plan = parts.plan("image", reference.features.names())
        twice = render_features(shown.image[[0, 0]], cameras[[0, 0]], stage.scene.subject, plan)
        stage.spent.network_passes += 2 * plan.passes
        features = twice[[0] + [1] * (len(cameras) - 1)]
    return score(stage.objective, reference.features, features, reference.missing)


def read_path(stage: Stage, cameras: Camera) -> Features:
    """Features of a path by the stage's extractors, each frame with the one before it."""
    frames: list[Features] = []
    before = None
    for i in range(len(cameras)):
        before = stage.features(cameras[i], before)
        frames.append(replace(before, image=None))
    return Features.concatenate(frames)
