"""Metric-only evaluation: two clips, no scene. The losses are the metrics."""

from __future__ import annotations

import time
from dataclasses import replace

import torch

from .clip import Clip, pair_by_time
from .clip_source import ClipSource
from .components import Components
from .config_options import RunConfig
from .errors import InputError
from .image_folder import FOLDER_RATE, TIMES, image_files
from .objective import Objective
from .open_clip import open_clip, rate_assumed
from .progress import Progress, silent
from .read_frames import read_frames
from .report.data import Flag, ReportData
from .run_files import kept_frames
from .scores import score


def evaluate(reference: str, render: str, config: RunConfig, progress: Progress = silent) -> ReportData:
    """Score the clip ``render`` against the clip ``reference``.

    Each frame of the render is paired with the frame of the reference nearest in time; both are read by the same image
    extractors, flow from one paired frame to the next.

    Args:
        reference: a video, an image folder or the folder of a run, which has kept its frames; or a part of one
            (:class:`cltransfer.clip_source.ClipSource`).
        render: as the reference, and starts when it does.
        config: which losses and extractors; ``frames`` thins the render.
        progress: called with a step, frames done, frames in all.

    Raises:
        InputError: a clip is missing, damaged or of an unfinished run, the reference has a cut or shows no person, or
            the two do not overlap in time.
    """
    start = time.perf_counter()
    parts = Components.build(config)
    plan = parts.plan("image")
    asked, found = ClipSource.parse(reference), ClipSource.parse(render)
    title = f"{found.path.name} against {asked.path.name}"
    asked, found = (replace(where, path=kept_frames(where.path)) for where in (asked, found))
    # a render is scored as it is: one that jumps is a bad render, not two shots
    shown, drawn = open_clip(replace(found, cuts="keep", letterbox="keep"), config.frames)
    original, flags = open_clip(asked)
    drawn += _one_by_one(found, original)
    plan.load_networks()
    paired = original.image[pair_by_time(original.times, shown.times)]
    features, read = read_frames(paired, plan, asked.who(shown.times, original.size), progress)
    if features.has("keypoints") and not bool(torch.isfinite(features.require("keypoints")).any()):
        raise InputError(reference, "person", f"none found in {len(paired)} frames")
    rendered, seen = read_frames(shown.image, plan, found.who(shown.times, shown.size), progress)
    scores = score(Objective(parts.losses), features, rendered, plan.missing)
    spent = {"network_passes": 2 * len(paired) * plan.passes, "seconds": round(time.perf_counter() - start, 2)}
    notes = [*(f"reference: {flag}" for flag in (*flags, *read)), *(f"render: {flag}" for flag in (*drawn, *seen))]
    told = tuple(Flag(None, note) for note in notes)
    return ReportData(title, shown.times, scores, None, None, None, paired, shown.image, told, spent)


def _one_by_one(render: ClipSource, original: Clip) -> tuple[str, ...]:
    """A note where ``render`` has an image for each frame of ``original``, but its assumed rate pairs others."""
    if not rate_assumed(render):
        return ()
    count = len(image_files(render.path))
    played = torch.arange(count).double() / FOLDER_RATE
    if count != len(original) or torch.equal(pair_by_time(original.times, played), torch.arange(count)):
        return ()
    rate = f"{(count - 1) / float(original.times[-1]):.4g}"
    asked = f"if its times are meant, name FOLDER#fps={rate} or write a {TIMES}"
    return (f"it has as many images as the reference has frames, {count}: {asked}",)
