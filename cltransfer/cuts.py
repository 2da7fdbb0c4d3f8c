"""Where one shot of a clip ends and another begins."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from .clip import timed_frames
from .clip_part import within
from .clip_source import ClipSource
from .errors import InputError

SIZE = (32, 18)  # of the small pictures that are compared [px]
BINS = 8  # of each colour's histogram
DIFFERENT = 0.45  # one minus correlation of two small pictures, in [0, 2]
RECOLOURED = 0.08  # part of the pixels that changed their bin
STANDS_OUT = 3.0  # over the usual change about it: a whip pan changes as much, but for many frames
_ROUNDED = 0.001  # [s] by which a moment may miss a shot
NEIGHBOURS = 4  # frames on either side that say what is usual


def find_cuts(small: np.ndarray) -> list[int]:
    """Frames that begin another shot.

    A cut changes what is where and how much there is of each colour, at once, and the frames after it do not go back:
    a flash does, and a fast camera changes its frames one after another.

    Args:
        small: small pictures (F, h, w, 3) uint8 of consecutive frames.

    Returns:
        Indices, increasing; frame 0 begins no other shot.
    """
    if len(small) < 2:
        return []
    change, recolour = _changes(small[:-1], small[1:])
    cuts = []
    for i in np.flatnonzero((change > DIFFERENT) & (recolour > RECOLOURED)).tolist():
        about = np.concatenate([change[max(0, i - NEIGHBOURS) : i], change[i + 1 : i + 1 + NEIGHBOURS]])
        usual = float(np.median(about)) if len(about) else 0.0
        later: int = min(i + 3, len(small) - 1)
        back, _ = _changes(small[i : i + 1], small[later : later + 1])
        if change[i] > STANDS_OUT * usual and back[0] > DIFFERENT:
            cuts.append(i + 1)
    return cuts


def check_one_shot(where: ClipSource) -> None:
    """Refuse a clip with a cut in the part of it that is read.

    Raises:
        InputError: there is one; the line says where and how to take one shot of the clip.
    """
    times, small = small_pictures(where.path, where.fps)
    inside = within(times, where.span)
    if len(inside) == 0:
        return
    cuts = [int(inside[0]) + cut for cut in find_cuts(small[inside])]
    if not cuts:
        return
    first, last = float(times[inside[0]]), float(times[cuts[0] - 1])
    more = f" and {len(cuts) - 1} more" if len(cuts) > 1 else ""
    begins, ends = float(times[cuts[0]]), float(times[cuts[1] - 1] if len(cuts) > 1 else times[inside[-1]])
    reason = f"a cut at {begins:.3f} s{more}; a reference is one shot"
    shots = [_part(where, first, (a, b)).named for a, b in ((first, last), (begins, ends)) if b > a]
    hint = f"take one: {' or '.join(shots)}; no cut? #cuts=keep" if shots else "no cut? #cuts=keep"
    raise InputError(where.path, f"frame {cuts[0]}", reason, hint)


def _part(where: ClipSource, first: float, span: tuple[float, float]) -> ClipSource:
    """A shot of ``where``, which begins at ``first`` [s]; a person who was pointed at is, if in that shot."""
    person = where.person
    if isinstance(person, tuple):
        x, y, moment = person
        later = first + moment - span[0]  # counted from the shot's beginning
        person = (x, y, max(0.0, later)) if -_ROUNDED < later < span[1] - span[0] + _ROUNDED else None
    return replace(where, span=span, person=person)


def small_pictures(path: Path, fps: float | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Times (F,) [s] and small pictures (F, h, w, 3) uint8 of every frame of a video or image folder."""
    frames: Iterable[tuple[float, np.ndarray]] = (
        (time, frame.raw.reformat(*SIZE, format="rgb24", interpolation="AREA").to_ndarray())
        for time, frame in timed_frames(path, fps)
    )
    times, small = zip(*frames)
    return np.array(times), np.stack(small)


def _changes(before: np.ndarray, after: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One minus correlation, (F,) in [0, 2], and part of the pixels in another bin of colour, (F,) in [0, 1]."""
    a, b = (x.reshape(len(x), -1).astype(np.float32) for x in (before, after))
    a, b = a - a.mean(1, keepdims=True), b - b.mean(1, keepdims=True)
    norm = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    flat = norm < 1e-3 * a.shape[1]  # a picture of one colour correlates with nothing
    correlation = np.where(flat, 1.0, (a * b).sum(1) / np.maximum(norm, 1e-9))
    moved = np.abs(_histograms(before) - _histograms(after)).sum((1, 2)) / 2 / 3
    return 1 - correlation, moved


def _histograms(small: np.ndarray) -> np.ndarray:
    """Part of the pixels in each bin of each colour, (F, 3, BINS)."""
    bins = small.reshape(len(small), -1, 3) // (256 // BINS)
    return np.stack([(bins == b).mean(1) for b in range(BINS)], axis=-1)
