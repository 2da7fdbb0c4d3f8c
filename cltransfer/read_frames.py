"""Frames to features: all persons found along the clip, one followed, and read by the image extractors."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import torch
from torch import Tensor

from .camera import Camera
from .errors import UsageError
from .features import Features
from .graph import CHUNK, run_clip
from .persons import Who, join
from .plan import Plan
from .progress import Progress, silent
from .scenes.find_people import Found, boxes_of
from .subject import Subject

Follow = Callable[[list[np.ndarray]], tuple[np.ndarray, tuple[str, ...]]]
"""Of all persons' boxes (P, 5) in each of N frames the one person's, (N, 5), NaN where it is not seen; and flags."""


def clip_features(image: Tensor, plan: Plan, progress: Progress = silent) -> Features:
    """Features of frames (N, 3, H, W) uint8, read by the image extractors of ``plan``; the largest person's."""
    return read_frames(image, plan, None, progress)[0]


def render_features(image: Tensor, cameras: Camera, subject: Subject | None, plan: Plan) -> Features:
    """Features of rendered frames (N, 3, H, W) uint8, read by the image extractors of ``plan``.

    Args:
        image: what N ``cameras`` of that size see.
        cameras: of the frames.
        subject: whose features are read: a bystander may be nearer; None is the largest person.
        plan: of image extractors.
    """
    if subject is None:
        return clip_features(image, plan)
    person = Found(subject.anchor, subject.height, len(cameras))
    return _read(image, plan, lambda boxes: (boxes_of(person, cameras, boxes).numpy(), ()), silent)[0]


def read_frames(image: Tensor, plan: Plan, who: Who, progress: Progress = silent) -> tuple[Features, tuple[str, ...]]:
    """Features of frames (N, 3, H, W) uint8, and what a reader should know.

    Where the plan's detector sees all persons, they are joined along the clip and one is followed.

    Args:
        image: the frames.
        plan: of image extractors.
        who: whom to follow; None is the largest.
        progress: called with a step, frames done, frames in all.

    Raises:
        UsageError: there is no such person.
    """
    if _detector(plan) is None and who not in (None, 0):
        raise UsageError("", "#person", "no extractor tells persons apart", "add extractors.detect_yolox={}")
    return _read(image, plan, lambda boxes: join(boxes).follow(who), progress)


def _detector(plan: Plan) -> Any:
    """The extractor that sees all persons, None where there is none."""
    return next((step.extractor for step in plan.steps if hasattr(step.extractor, "persons")), None)


def _read(image: Tensor, plan: Plan, follow: Follow, progress: Progress) -> tuple[Features, tuple[str, ...]]:
    count, detector = len(image), _detector(plan)
    load = partial(_loaded, image, None)
    flags: tuple[str, ...] = ()
    if detector is not None:
        found = []
        for start in range(0, count, CHUNK):
            found += detector.persons(load(start, start + CHUNK))
            progress("finding persons", min(start + CHUNK, count), count)
        box, flags = follow(found)
        load = partial(_loaded, image, torch.from_numpy(box).float())
        plan = plan.without(detector)
    features = run_clip(plan, load, count, lambda done: progress("reading frames", done, count))
    return features, flags


def _loaded(image: Tensor, box: Tensor | None, start: int, stop: int) -> Features:
    size = (image.shape[3], image.shape[2])
    return Features(size, image=image[start:stop].float() / 255, box=None if box is None else box[start:stop])
