"""Metric-only evaluation: two clips, no scene. The losses are the metrics."""

from __future__ import annotations

import time
from pathlib import Path

import torch

from .clip import pair_by_time, read_clip
from .config import RunConfig
from .errors import InputError
from .objective import Objective
from .reference import Components, Progress, clip_features, silent
from .report.data import ReportData
from .scores import score


def evaluate(reference: str, render: str, config: RunConfig, progress: Progress = silent) -> ReportData:
    """Score the clip ``render`` against the clip ``reference``.

    Each frame of the render is paired with the frame of the reference nearest in time; both are read by the same image
    extractors, flow from one paired frame to the next.

    Args:
        reference: a video or an image folder.
        render: a video or an image folder that starts when the reference does.
        config: which losses and extractors; ``frames`` thins the render.
        progress: called with a step, frames done, frames in all.

    Raises:
        InputError: a clip is missing, damaged, shows no person, or the two do not overlap in time.
    """
    start = time.perf_counter()
    parts = Components.build(config)
    plan = parts.plan("image")
    shown = read_clip(Path(render), config.frames)
    original = read_clip(Path(reference))
    plan.load_networks()
    paired = original.image[pair_by_time(original.times, shown.times)]
    features = clip_features(paired, plan, progress)
    if features.has("keypoints") and not bool(torch.isfinite(features.require("keypoints")).any()):
        raise InputError(reference, "person", f"none found in {len(paired)} frames")
    rendered = clip_features(shown.image, plan, progress)
    scores = score(Objective(parts.losses), features, rendered, plan.missing)
    spent = {"network_passes": 2 * len(paired) * plan.passes, "seconds": round(time.perf_counter() - start, 2)}
    title = f"{Path(render).name} against {Path(reference).name}"
    return ReportData(title, shown.times, scores, None, None, None, paired, shown.image, (), spent)
