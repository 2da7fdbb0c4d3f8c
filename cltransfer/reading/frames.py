"""Frames to features: all persons found along the clip, one followed, and read by the image extractors."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..camera import Camera
from ..clips.gaps import filled
from ..clips.join_persons import join
from ..clips.persons import Who
from ..computer.memory import require_free
from ..errors import InputError, UsageError
from ..features import Features, nobody
from ..pipeline.graph import CHUNK, persons_in, run_clip
from ..pipeline.plan import Plan
from ..placement import visible_joints
from ..progress import Progress, silent
from ..scenes.person.find_people import boxes_of_subject
from ..subject import Subject

MAPS = 48  # bytes a pixel of a clip, at the peak: 37 measured without a depth network, whose maps are added
HINT = "thin the clip by frames=, or take a part, #t=START,END"
ELSEWHERE = "another part of it: #t=START,END, or more frames="  # somebody may be seen

Follow = Callable[[list[np.ndarray]], tuple[np.ndarray, tuple[str, ...]]]
"""Of all persons' boxes (P, 5) in each of N frames the one person's, (N, 5), NaN where it is not seen; and flags."""


def check_maps(*images: Tensor) -> None:
    """Refuse clips, each (N, 3, H, W), of which more would be read than there is memory for.

    Raises:
        ResourceError: less is free than the maps of all their frames take.
    """
    check_room(*((len(image), image.shape[3], image.shape[2]) for image in images))


def check_room(*clips: tuple[int, int, int]) -> None:
    """:func:`check_maps` of clips that are not there yet: how many frames each has, how wide and how high.

    Raises:
        ResourceError: less is free than the maps of all their frames take.
    """
    need = sum(MAPS * count * width * height for count, width, height in clips)
    what = " and ".join(f"{count} of {width}x{height}" for count, width, height in clips)
    require_free(need, "", f"the maps of frames, {what},", HINT)


def require_person(source: str, features: Features, hint: str = ELSEWHERE) -> None:
    """Refuse the reference ``source`` where somebody was looked for and nobody is in any frame.

    Raises:
        InputError: there is none; ``hint`` says what to do, of a clip by default.
    """
    if bool(nobody(features).all()):
        raise InputError(source, "person", f"none found in {len(features)} frames", hint)


def hidden(features: Features) -> Tensor:
    """Frames (N,) bool in which neither a joint nor a pixel of the person shows, though a scene knows where it is."""
    shown = torch.ones(len(features), dtype=torch.bool)
    if features.has("keypoints"):
        shown = visible_joints(features.require("keypoints")).any(1)
        if features.has("subject"):
            shown |= features.require("subject").flatten(1).any(1)
    return ~shown


def clip_features(image: Tensor, plan: Plan, progress: Progress = silent, times: Tensor | None = None) -> Features:
    """Features of the N frames of one clip, read by the image extractors of ``plan``; the largest person's.

    Frames follow one another: flow goes from each to the next and is NaN in the first, and one person is followed
    through all of them. So a clip is read in one call; images that are none have no movement to compare.

    What a reader of whole clips cannot tell of them (``extractors.depth_sfm`` where nothing moves) is in ``reasons``;
    of two clips that are compared, :func:`read_alike` has them read by one rule all the same.

    Args:
        image: consecutive frames, (N, 3, H, W) uint8.
        plan: of image extractors.
        progress: called with a step, frames done, frames in all.
        times: of the frames, (N,) [s], increasing, by which the person is followed; None takes 24 a second.

    Raises:
        ValueError: ``image`` or ``times`` is anything else.
        ModelError: a network that the plan reads by is not there, or what is read has values that it cannot have.
        ResourceError: what is read takes more memory than is free.
    """
    _check_frames(image)
    if times is not None:
        _check_times(times, len(image))
    return read_frames(image, plan, None, progress, times)[0]


def _check_frames(image: object) -> None:
    came = type(image).__name__
    if isinstance(image, Tensor):
        if image.dtype == torch.uint8 and image.ndim == 4 and image.shape[1] == 3 and image.numel():
            return
        came = f"{str(image.dtype).removeprefix('torch.')} {tuple(image.shape)}"
        came += ": (frames * 255).round().byte()" * image.is_floating_point()
    raise ValueError(f"expected uint8 frames (N, 3, H, W), got {came}")


def _check_times(times: object, count: int) -> None:
    came: object = type(times).__name__
    if isinstance(times, Tensor):
        if times.shape == (count,) and bool((times.isfinite()).all() and (times.diff() > 0).all()):
            return
        came = tuple(times.shape) if times.shape != (count,) else times.tolist()
    raise ValueError(f"expected a tensor of the increasing times of {count} frames [s], got {came}")


def render_features(
    image: Tensor, cameras: Camera, subject: Subject | None, plan: Plan, times: Tensor | None = None
) -> Features:
    """Features of rendered frames (N, 3, H, W) uint8, read by the image extractors of ``plan``.

    Args:
        image: what N ``cameras`` of that size see.
        cameras: of the frames.
        subject: whose features are read: a bystander may be nearer; None is the largest person.
        plan: of image extractors.
        times: of the frames, (N,) [s]; None takes 24 a second.
    """
    return read_renders(image, cameras, subject, plan, times)[0]


def read_renders(
    image: Tensor,
    cameras: Camera,
    subject: Subject | None,
    plan: Plan,
    times: Tensor | None = None,
    progress: Progress = silent,
) -> tuple[Features, tuple[str, ...]]:
    """:func:`render_features`, and what a reader should know; ``progress`` as of :func:`read_frames`."""
    if subject is None:
        return read_frames(image, plan, None, progress, times)
    shown = None if times is None else times.double().numpy()
    return _read(image, plan, lambda boxes: (boxes_of_subject(subject, cameras, boxes).numpy(), ()), progress, shown)


def read_frames(
    image: Tensor,
    plan: Plan,
    who: Who,
    progress: Progress = silent,
    times: Tensor | None = None,
    clip: str | Path = "",
) -> tuple[Features, tuple[str, ...]]:
    """Features of frames (N, 3, H, W) uint8, and what a reader should know.

    Where the plan's detector sees all persons, they are joined along the clip and one is followed.

    Args:
        image: the frames.
        plan: of image extractors.
        who: whom to follow; None is the largest.
        progress: called with a step, frames done, frames in all.
        times: of the frames, (N,) [s], increasing; None takes 24 a second.
        clip: for error lines.

    Raises:
        UsageError: there is no such person.
        ResourceError: see :func:`check_maps`.
    """
    if plan.detector is None and who not in (None, 0):
        hint = "add extractors.detect_yolox={}, and a loss that asks for what is read off a person"
        raise UsageError(clip, "#person", "no extractor in use tells persons apart", hint)
    shown = None if times is None else times.double().cpu().numpy()
    return _read(image, plan, lambda boxes: join(boxes, shown).follow(who, clip), progress, shown)


def read_alike(features: Features, image: Tensor, plan: Plan, other: Features, progress: Progress = silent) -> Features:
    """Features of frames (N, 3, H, W) uint8, by the rule by which those of the ``other`` side could be read.

    They are ``features`` as ``plan`` gave them; but where those of the other side had to do without what a step uses,
    as depth that its whole clip does not tell, the frames are read anew without that, of the same person.

    Raises:
        ResourceError: see :func:`check_maps`.
    """
    alike = plan.hiding(other.reasons.keys() - features.reasons.keys())
    if alike == plan:
        return features
    check_maps(image)
    return _of_person(image, alike, features.box, progress)


def _read(
    image: Tensor, plan: Plan, follow: Follow, progress: Progress, times: np.ndarray | None
) -> tuple[Features, tuple[str, ...]]:
    check_maps(image)
    count, detector = len(image), plan.detector
    if detector is None:
        return _of_person(image, plan, None, progress), ()
    found = list[np.ndarray]()
    for start in range(0, count, CHUNK):
        found += persons_in(detector, _loaded(image, None, start, start + CHUNK))
        progress("finding persons", min(start + CHUNK, count), count)
    box, flags = follow(found)
    box = filled(box, times, found) if plan.doubts_boxes else box
    return _of_person(image, plan, torch.from_numpy(box).float().to(image.device), progress), flags


def _of_person(image: Tensor, plan: Plan, box: Tensor | None, progress: Progress) -> Features:
    """Features of frames, of the person in ``box`` (N, 5); None has the plan look for the main one in each frame."""
    steps = plan if box is None else plan.person_known
    load = partial(_loaded, image, box)
    return run_clip(steps, load, len(image), progress)


def _loaded(image: Tensor, box: Tensor | None, start: int, stop: int) -> Features:
    size = (image.shape[3], image.shape[2])
    return Features(size, image=image[start:stop].float() / 255, box=None if box is None else box[start:stop])
