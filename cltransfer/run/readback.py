"""Reading back what was found: frames rendered, read by networks or by geometry, scored against the reference."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..camera import Camera
from ..clips.decoding import PIXEL_LIMIT
from ..clips.part import BYTE_LIMIT
from ..computer.memory import require_free
from ..drawing import drawn_by
from ..driver.stage import Stage, read_path
from ..errors import ResourceError
from ..features import Features
from ..pipeline.components import Components
from ..pipeline.scores import Scores, score
from ..progress import Progress, silent
from ..reading.frames import render_features
from ..reading.reference import Reference, beside, quantised
from ..scenes import Scene
from .kept_reading import Read, kept_reading

RENDER_BATCH = 8  # frames of a video rendered together
READ_BACK = 60  # bytes a pixel of the result; 47 measured at the peak, while its maps are read
HINT = "lower output_side or frames"


@dataclass(frozen=True)
class Readback:
    """A path as its reference would be read.

    Args:
        image: the rendered frames, (N, 3, H, W) uint8, as they are kept.
        read: what the extractors saw in them, and how it scores.
        reference: by the rule by which the frames could be read (:func:`~cltransfer.reading.reference.beside`).
    """

    image: Tensor  # (N, 3, H, W) uint8
    read: Read
    reference: Reference

    @property
    def features(self) -> Features:
        """Places that the extractors saw in the frames; their maps were scored and let go."""
        return self.read.features

    @property
    def scores(self) -> Scores:
        """Against the reference."""
        return self.read.scores


def check_frames(count: int, size: tuple[int, int]) -> None:
    """Refuse a video of ``count`` frames of (W, H) [px] that cannot be kept in memory, or not be read again.

    Raises:
        ResourceError: it takes more than the limit, or than is free, or its frames are larger than those of any clip.
    """
    written = [side + side % 2 for side in size]  # as .mp4 has it
    if written[0] * written[1] > PIXEL_LIMIT:
        reason = f"expected at most {PIXEL_LIMIT} pixels each, got {size[0]}x{size[1]}"
        raise ResourceError("", "frames", reason, "lower output_side")
    need = 3 * count * size[0] * size[1]
    if need > BYTE_LIMIT:
        reason = f"{count} of {size[0]}x{size[1]} need {need} bytes, the limit is {BYTE_LIMIT}"
        raise ResourceError("", "frames", reason, HINT)
    require_free(need, "", f"{count} frames of {size[0]}x{size[1]}", HINT)


def check_result(count: int, size: tuple[int, int]) -> None:
    """Refuse a transfer whose result, ``count`` frames of (W, H) [px], cannot be read back: that comes last.

    Raises:
        ResourceError: see :func:`check_frames`, or there is less free than the maps of all frames take.
    """
    check_frames(count, size)
    width, height = size
    require_free(READ_BACK * count * width * height, "", f"the maps of {count} frames of {width}x{height}", HINT)


def render_frames(scene: Scene, parts: Components, cameras: Camera, progress: Progress = silent) -> Tensor:
    """Frames (N, 3, H, W) uint8 of N cameras.

    Raises:
        ResourceError: see :func:`check_frames`.
    """
    check_frames(len(cameras), cameras.size)
    image = torch.empty((len(cameras), 3, *cameras.size[::-1]), dtype=torch.uint8)
    for start in range(0, len(cameras), RENDER_BATCH):
        end = min(start + RENDER_BATCH, len(cameras))
        drawn = drawn_by(parts.renderer, scene, cameras[start:end], frozenset({"image"}))
        image[start:end] = quantised(drawn.require("image"))
        progress("rendering", end, len(cameras))
    return image


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
    if not by_networks:
        features = read_path(replace(stage, size=cameras.size), cameras)
        scores = score(stage.objective, reference.features, features, reference.missing)
        return Readback(image, Read.of(features, scores), reference)
    plan = parts.plan("image", reference.features.names()).hiding(reference.without)
    alike: Reference | None = None

    def read() -> Read:
        nonlocal alike
        features = render_features(image, cameras, stage.scene.subject, plan, reference.times)
        alike = beside(features, reference, parts, progress)
        return Read.of(features, score(stage.objective, alike.features, features, alike.missing))

    seen = kept_reading(stage, cameras, read)
    stage.spent.network_passes += len(image) * plan.clip_passes
    if alike is None:  # the journal has told what was read
        alike = beside(seen.features, reference, parts, progress)
    return Readback(image, seen, alike)


def read_held(stage: Stage, parts: Components, shown: Readback, cameras: Camera) -> Scores | None:
    """Scores of the first view held still for the whole clip: what a transfer has to beat.

    Two frames of it are read; every later one is as the second, since the scene does not move. None where it lacks what
    the result has, as depth that is read off the movement: it would pay the penalty, or be read by another rule, and
    anything would beat it.
    """
    twice, reference = cameras[[0] * min(2, len(cameras))], shown.reference
    if "camera" in shown.read.names:
        seen = read_path(replace(stage, size=cameras.size), twice)
    else:
        plan = parts.plan("image", reference.features.names()).hiding(reference.without)
        seen = render_features(shown.image[[0] * len(twice)], twice, stage.scene.subject, plan)
        stage.spent.network_passes += len(twice) * plan.clip_passes
    asked = {name for loss in stage.objective.losses.values() for name in loss.requires} | seen.reasons.keys()
    if any(name in shown.read.names and not seen.has(name) for name in asked):
        return None
    features = seen[[0] + [1] * (len(cameras) - 1)]
    return score(stage.objective, reference.features, features, reference.missing)
