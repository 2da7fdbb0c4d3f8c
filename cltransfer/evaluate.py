"""Metric-only evaluation: two clips, no scene. The losses are the metrics."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import torch
from torch import Tensor

from .clip import Clip, pair_by_time
from .clip_source import ClipSource
from .components import Components
from .config_options import RunConfig
from .errors import InputError
from .features import Features
from .image_folder import FOLDER_RATE, TIMES, image_files
from .objective import Objective
from .open_clip import open_clip, rate_assumed
from .progress import Progress, silent
from .read_frames import check_maps, read_frames
from .report.data import Flag, ReportData
from .run_files import kept_frames
from .scores import score

ROUNDED = 0.0011  # [s]: videos keep milliseconds, and a step has two of them


def evaluate(reference: str, render: str, config: RunConfig, progress: Progress = silent) -> ReportData:
    """Score the clip ``render`` against the clip ``reference``.

    Frames are paired by time, each of the reference with one of the render at most. Both are read by the same image
    extractors, and by one rule: what only one side has (depth from its movement, say) helps neither to read the rest.
    Flow goes from one pair to the next; the render's is taken in the time that passes in the reference.

    Args:
        reference: a video, an image folder or the folder of a run, which has kept its frames; or a part of one
            (:class:`cltransfer.clip_source.ClipSource`).
        render: as the reference, and starts when it does.
        config: which losses and extractors; ``frames`` thins the render.
        progress: called with a step, frames done, frames in all.

    Raises:
        InputError: a clip is missing, damaged or of an unfinished run, the reference has a cut or shows no person, or
            the two do not overlap in time.
        ResourceError: there is not memory enough to read both.
    """
    start = time.perf_counter()
    parts = Components.build(config)
    plan = parts.plan("image")
    asked, found = ClipSource.parse(reference), ClipSource.parse(render)
    title = f"{found.path.name} against {asked.path.name}"
    asked, found = (replace(where, path=kept_frames(where.path)) for where in (asked, found))
    # unless asked otherwise a render is scored as it is: one that jumps is a bad render, not two shots
    shown, drawn = open_clip(
        replace(found, cuts=found.cuts or "keep", letterbox=found.letterbox or "keep"), config.frames
    )
    original, flags = open_clip(asked)
    drawn += _one_by_one(found, original)
    plan.load_networks()
    first, second = pairs(original.times, shown.times)
    drawn += _not_scored(original.times, shown.times, len(second))
    taught, made = original.image[first], shown.image[second]
    check_maps(taught, made)
    times = shown.times[second]
    whom, who = asked.who(times, original.size), found.who(times, shown.size)
    features, read = read_frames(taught, plan, whom, progress)
    if features.has("keypoints") and not bool(torch.isfinite(features.require("keypoints")).any()):
        raise InputError(reference, "person", f"none found in {len(times)} frames")
    rendered, seen = read_frames(made, plan, who, progress)
    alike = plan.hiding(features.reasons.keys() ^ rendered.reasons.keys())
    if alike != plan:
        features, rendered = read_frames(taught, alike, whom, progress)[0], read_frames(made, alike, who, progress)[0]
    rendered = in_time(rendered, original.times[first].diff(), times.diff())
    scores = score(Objective(parts.losses), features, rendered, plan.missing)
    passes = 2 * len(times) * plan.passes * (1 if alike == plan else 2)
    spent = {"network_passes": passes, "seconds": round(time.perf_counter() - start, 2)}
    notes = [*(f"reference: {flag}" for flag in (*flags, *read)), *(f"render: {flag}" for flag in (*drawn, *seen))]
    told = tuple(Flag(None, note) for note in notes)
    return ReportData(title, times, scores, None, None, None, taught, made, told, spent)


def pairs(original: Tensor, shown: Tensor) -> tuple[Tensor, Tensor]:
    """Which frames go together, (P,) int64 each, of a reference at times (N,) and a render at times (M,) [s].

    Each of the render has the nearest of the reference; of those that have the same one, the nearest is kept, and none
    that is shown a whole step of the reference before it begins or after it ends.

    Raises:
        InputError: the two share no moment.

    >>> pairs(torch.tensor([0.0, 0.5, 1.0]), torch.tensor([0.0, 0.2, 0.4, 0.9, 1.1, 5.0]))
    (tensor([0, 1, 2]), tensor([0, 2, 3]))
    >>> pairs(torch.tensor([0.0, 0.5, 1.0]), torch.tensor([0.0, 5.0]))
    (tensor([0]), tensor([0]))
    """
    nearest = pair_by_time(original, shown)
    apart = (original[nearest] - shown).abs()
    counts = torch.unique_consecutive(nearest, return_counts=True)[1]
    kept = torch.stack([same[apart[same].argmin()] for same in torch.arange(len(shown)).split(counts.tolist())])
    if len(original) > 1:
        steps = original.diff()
        outside = (shown <= original[0] - steps[0]) | (shown >= original[-1] + steps[-1])
        kept = kept[~outside[kept]]
    if not len(kept):
        raise InputError("", "times", "the clips share no moment: all frames of one lie before or after the other")
    return nearest[kept], kept


def _not_scored(original: Tensor, shown: Tensor, pairs: int) -> tuple[str, ...]:
    """Notes on frames that have no partner, at times (N,) and (M,) [s]."""
    notes = []
    if pairs < len(shown):
        ends = f"which has {len(original)} up to {float(original[-1]):.2f} s"
        notes.append(f"{pairs} of {len(shown)} frames are scored, one for a frame of the reference, {ends}")
    steps = [float(times.diff().median()) for times in (original, shown) if len(times) > 1]
    if float(original[-1] - shown[-1]) > 1.5 * max(steps, default=math.inf):
        ends = f"{float(shown[-1]):.2f} s, the reference at {float(original[-1]):.2f} s"
        notes.append(f"ends at {ends}: what comes after is not scored")
    return tuple(notes)


def in_time(rendered: Features, original: Tensor, shown: Tensor) -> Features:
    """Features of a render whose steps take ``shown`` [s], with the flow of steps of ``original`` [s], (P - 1,) each.

    Steps that differ by no more than their times are rounded are the same.
    """
    other = (original - shown).abs() > ROUNDED
    if not rendered.has("flow") or not bool(other.any()):
        return rendered
    flow = rendered.require("flow")
    share = torch.cat([torch.ones(1), torch.where(other, original / shown, 1.0)]).to(flow)
    return replace(rendered, flow=flow * share[:, None, None, None])


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
