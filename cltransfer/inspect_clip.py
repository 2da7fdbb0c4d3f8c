"""A clip's reading laid open: what was found in each frame, drawn, and how much of each term can be had."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from .computer.threads import default_count, set_threads, threads_restored
from .config.options import RunConfig
from .describe.shot_scale import SCALES, shot_scale
from .errors import InputError, UsageError
from .features import Features
from .pipeline.components import Components
from .pipeline.scores import Scores, score
from .placement import frame_joints, visible_joints
from .progress import Progress, silent
from .reading.reference import Reading, Reference, read_reference
from .reading.scene_source import is_scene


@dataclass(frozen=True)
class Inspection:
    """A clip as it was read.

    Args:
        source: how the clip is named, with the part of it that is read.
        reference: its features, frames and flags.
        scores: of the clip against itself: a term is defined where it scores, and then it is 0.
        confidence: how far each frame's person can be trusted, (N,) in [0, 1]; 0 where there is none.
        seconds: that reading took; little where it had been read before.
    """

    source: str
    reference: Reference
    scores: Scores
    confidence: Tensor  # (N,)
    seconds: float

    @property
    def seen(self) -> int:
        """Frames that show the person."""
        return int(visible_joints(self.reference.features.require("keypoints")).any(1).sum())

    def captions(self) -> list[str]:
        """A line for each frame: time, shot size, key joints seen, angles, confidence."""
        features = self.reference.features
        scale = shot_scale(features).tolist()
        joints = visible_joints(frame_joints(features)).sum(1).tolist()
        seen = visible_joints(features.require("keypoints")).any(1)
        angles = torch.full((len(features), 3), float("nan"))
        if features.has("orientation"):
            angles = torch.rad2deg(features.require("orientation"))
        lines = []
        for i, moment in enumerate(self.reference.times.tolist()):
            shown = "no shot size" if bool(seen[i]) else "no person"
            words = [f"{i}: {moment:.2f} s", SCALES[scale[i]] if scale[i] >= 0 else shown]
            if scale[i] >= 0:
                words += [f"{joints[i]}/5 key joints", f"confidence {float(self.confidence[i]):.2f}"]
            if bool(seen[i]) and bool(torch.isfinite(angles[i]).all()):
                words.append("yaw {:.0f}°, pitch {:.0f}°, roll {:.0f}°".format(*angles[i].tolist()))
            lines.append(", ".join(words))
        return lines


@threads_restored()
def inspect_clip(source: str, config: RunConfig, progress: Progress = silent) -> Inspection:
    """Read ``source`` as a transfer would, meanwhile with the threads of ``config``.

    Raises:
        InputError: it is missing, damaged, has a cut, or shows no person in any frame.
        UsageError: by the config no joints would be read.
    """
    set_threads(config.threads or default_count())
    start = time.perf_counter()
    parts = Components.build(config)
    is_file = source.endswith(".safetensors")  # it has its features, whatever the config asks for
    if not is_file:
        _check_joints(source, parts)
    reference = read_reference(source, parts, Reading(config.frames, config.output_side, "scene"), progress)
    if is_file and not reference.features.has("keypoints"):
        raise InputError(source, "keypoints", "expected joints of a person, the file has none", "inspect the clip")
    scores = score(parts.objective, reference.features, reference.features, reference.missing)
    seconds = time.perf_counter() - start
    return Inspection(source, reference, scores, reading_confidence(reference.features), seconds)


def _check_joints(source: str, parts: Components) -> None:
    """Refuse what would read no joints: every line of the page is about them."""
    plan = parts.plan("scene" if is_scene(source) else "image")
    if "keypoints" in plan.missing:
        raise UsageError(source, "keypoints", plan.missing["keypoints"], "an inspection shows the person's joints")
    if "keypoints" not in plan.wanted:
        reason = "expected a loss that reads the person's joints, none is left"
        raise UsageError(source, "losses", reason, "leave losses.shot_size in")


def reading_confidence(features: Features) -> Tensor:
    """How far the person of each frame can be trusted, (N,) in [0, 1]: detection times mean of the visible key joints.

    0 where there is nobody, or only a guess of the place; where nothing detects persons the joints count alone.
    """
    joints = frame_joints(features)
    visible = visible_joints(joints)
    mean = (joints[..., 2].nan_to_num(0) * visible).sum(1) / visible.sum(1).clamp_min(1)
    if features.has("box"):
        mean = mean * features.require("box")[:, 4].nan_to_num(0).clamp(0, 1)
    return mean


def write_inspection(folder: Path, shown: Inspection) -> Path:
    """Write ``index.html`` and a picture of each frame and its flow into ``folder``; returns the page's path.

    Raises:
        InputError: the reference is a feature file, which keeps no frames.
        OSError: a picture cannot be written.
    """
    from .report.inspection_page import write_page
    from .report.overlays import draw_flow, draw_reading
    from .report.picture import write_picture

    reference, features = shown.reference, shown.reference.features
    if reference.image is None:
        raise InputError(reference.name, "frames", "a feature file keeps none to draw on", "inspect the clip itself")
    fastest = _fastest(features)
    page = write_page(folder, shown)  # first: a folder with pictures and no page is taken for somebody else's
    for i in range(len(features)):
        own = features[i]
        if features.has("keypoints"):
            own = replace(own, keypoints=own.require("keypoints").double())
        pictures = {f"{i:04d}.png": draw_reading(reference.image[i], own)}
        if features.has("flow"):
            pictures[f"{i:04d}_flow.png"] = draw_flow(own, fastest)
        for name, picture in pictures.items():
            write_picture(folder / "frames" / name, picture, lasting=False)
    return page


def _fastest(features: Features) -> float:
    """Speed that nineteen of twenty pixels stay below, at least one pixel [px]."""
    if not features.has("flow"):
        return 1.0
    speed = features.require("flow").norm(dim=1).flatten()
    known = speed[torch.isfinite(speed)]
    return max(1.0, float(torch.quantile(known[:: max(1, len(known) // 100_000)], 0.95))) if len(known) else 1.0
