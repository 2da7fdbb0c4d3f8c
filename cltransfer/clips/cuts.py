"""Where one shot of a clip ends and another begins."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ..errors import InputError
from .letterbox import BLACK, MOST
from .part import ClipPart
from .source import ClipSource

BINS = 8  # of each colour's histogram
DIFFERENT = 0.45  # one minus correlation of two small pictures, in [0, 2]
RECOLORED = 0.08  # part of the pixels that changed their bin
FLASH = 2  # pictures at most that are no shot where what was seen before is seen after them
STANDS_OUT = 3.0  # over the usual change about it: a whip pan changes as much, but for many frames
FLAT = 2.0  # standard deviation of each colour [levels] below which a picture shows nothing
LEFT = 1 - MOST  # of a side, at least, that is picture: less is a scene in the dark
_ROUNDED = 0.001  # [s] by which a moment may miss a shot
NEIGHBOURS = 4  # changes on either side that say what is usual
SAME = 0.002  # change at most of a frame that is shown again
GAP = 3.0  # over the usual step of time: frames are missing
BLOCK = 256  # pictures that are compared at a time
BLENDS = (1, 2)  # frames between two shots that mix the last of one and the first of the other
STIRS = 0.02  # change at least from each frame to the next where two shots are mixed
LEAST_SHARE = 0.1  # of either shot in a frame that mixes two
MIXED = 0.1  # of the square of how the frames on both sides differ, that a mix of both may miss a blend by
REPEATS = 3  # times that a frame is shown again at most; more is a still camera


def find_shots(small: np.ndarray) -> list[tuple[int, int]]:
    """First and last frame of every shot, without frames that show nothing.

    A cut changes what is where and how much there is of each colour, at once, and the frames after it do not go back:
    a flash does, a fast camera changes its frames one after another, and a short whip pan shifts them. Frames that show
    nothing, black or white, belong to no shot: what is seen before them is held against what is seen after. Nor do one
    frame or two that mix both shots, as those do that are made between two others; longer dissolves are no cut.

    Args:
        small: small pictures (F, h, w, 3) uint8 of consecutive frames.

    Returns:
        Indices, increasing; none where no frame shows anything.
    """
    small = _without_bars(small)
    varied = [block.std((1, 2), dtype=np.float32).max(1) for block in _blocks(small)]
    shown = np.flatnonzero(np.concatenate(varied) >= FLAT)
    if len(shown) < 2:
        return [(int(only), int(only)) for only in shown]
    pictures = small[shown]
    change, recolor = _changes(pictures[:-1], pictures[1:])
    if (mixed := _blended(pictures, change)).any():
        shown = shown[~mixed]
        pictures = small[shown]
        change, recolor = _changes(pictures[:-1], pictures[1:])
    apart = np.flatnonzero(np.diff(shown) > 1)  # maybe faded: as if their colours were in full
    if len(apart):
        _, recolor[apart] = _changes(_full_range(pictures[apart]), _full_range(pictures[apart + 1]))
    told = np.flatnonzero(~_repeats(change))
    change, recolor = change[told], recolor[told]
    candidates = np.flatnonzero((change > DIFFERENT) & (recolor > RECOLORED)).tolist()
    cuts = [k for k in candidates if _stands_out(change, k) and _stays(pictures, told, k)]
    begins = [0, *(int(told[k]) + 1 for k in cuts if not _whips(pictures, told, change, k))]
    return [(int(shown[a]), int(shown[b - 1])) for a, b in pairwise([*begins, len(shown)])]


def _blended(pictures: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Which pictures (F,), of changes (F - 1,), mix one that is before them with one behind that is unlike it."""
    found = np.zeros(len(pictures), bool)
    for between in BLENDS:
        if len(change) <= between:
            continue
        for i in np.flatnonzero(sliding_window_view(change > STIRS, between + 1).all(1)):
            after = i + 1 + between
            apart = _unlike(pictures[i : i + 1], pictures[after : after + 1])[0]
            usual = np.concatenate([change[max(i - NEIGHBOURS, 0) : i], change[after : after + NEIGHBOURS]])
            if apart <= max(DIFFERENT, STANDS_OUT * (between + 1) * np.median(usual) if len(usual) else 0.0):
                continue  # a fast camera: a frame of it is about the mean of its neighbours
            if _are_mixed(pictures[i + 1 : after], pictures[i], pictures[after]):
                found[i + 1 : after] = True
    return found


def _are_mixed(pictures: np.ndarray, first: np.ndarray, last: np.ndarray) -> bool:
    """Whether all of ``pictures`` (B, h, w, 3) are ``first`` and ``last`` in some shares."""
    whole = last.astype(np.float32) - first
    gone = pictures.astype(np.float32) - first
    share = (gone * whole).sum((1, 2, 3), keepdims=True) / np.maximum(np.square(whole).sum(), 1e-9)
    missed = np.square(gone - share * whole).sum((1, 2, 3))
    of_both = (share > LEAST_SHARE) & (share < 1 - LEAST_SHARE)
    return bool(of_both.all() and (missed < MIXED * np.square(whole).sum()).all())


def _stands_out(change: np.ndarray, k: int) -> bool:
    return bool(change[k] > STANDS_OUT * np.median(_beside(change, k, NEIGHBOURS) if len(change) > 1 else 0))


def _beside(change: np.ndarray, k: int, count: int) -> np.ndarray:
    """Up to ``count`` of the changes on either side of the ``k``-th."""
    return np.concatenate([change[max(k - count, 0) : k], change[k + 1 : k + 1 + count]])


def _stays(pictures: np.ndarray, told: np.ndarray, k: int) -> bool:
    """Whether neither what is seen before the change ``told[k]`` is seen after, nor what is seen after it before."""
    i = told[k]
    earlier = told[k - FLASH] if k >= FLASH else 0
    later = told[k + FLASH] + 1 if k + FLASH < len(told) else len(pictures) - 1
    back, _ = _changes(pictures[[earlier, i]], pictures[[i + 1, later]])
    return bool((back > DIFFERENT).all())


def _whips(pictures: np.ndarray, told: np.ndarray, change: np.ndarray, k: int) -> bool:
    """Whether the change ``told[k]`` is a step of a whip pan: beside another, and a shift along a side explains it.

    A cut into a whip pan is beside one as well, so that alone says nothing.
    """
    if _beside(change, k, 1).max(initial=0) <= DIFFERENT:
        return False
    for axis in (0, 1):
        a, b = (np.moveaxis(picture, axis, 0) for picture in pictures[told[k] : told[k] + 2])
        for shift in range(1, len(a) // 2 + 1):
            ahead, behind = (a[shift:], b[:-shift]), (a[:-shift], b[shift:])
            if min(_unlike(x[None], y[None])[0] for x, y in (ahead, behind)) <= DIFFERENT:
                return True
    return False


def _without_bars(small: np.ndarray) -> np.ndarray:
    """Small pictures (F, h, w, 3) without rows and columns at their edges that stay black, and half black ones beside.

    Bars are alike on both sides of a cut, and two shots seem alike with them.
    """
    lit = small.max(axis=(0, 3)) > BLACK
    spans = []
    for seen in (lit.any(1), lit.any(0)):
        inside = np.flatnonzero(seen)
        first, last = (inside[0], inside[-1]) if len(inside) else (0, len(seen) - 1)
        enough = last + 1 - first >= LEFT * len(seen)  # before what is half black goes
        first, last = first + (first > 0), last - (last < len(seen) - 1)
        spans.append(slice(first, last + 1) if enough else slice(None))
    return small[:, spans[0], spans[1]]


def _repeats(change: np.ndarray) -> np.ndarray:
    """Which changes (F,) are those of frames shown again, as of 24 a second in a file of 60.

    >>> _repeats(np.array([0.3, 0.0, 0.3, 0.0, 0.0, 0.3])).tolist(), _repeats(np.zeros(3)).tolist()
    ([False, True, False, True, True, False], [False, False, False])
    """
    moving = np.flatnonzero(change > SAME)
    repeats = np.zeros(len(change), bool)
    for a, b in pairwise(moving):
        repeats[a + 1 : b] = b - a <= REPEATS + 1
    return repeats


def check_one_shot(where: ClipSource, part: ClipPart) -> tuple[str, ...]:
    """Refuse a clip with a cut in the ``part`` of it that ``where`` names.

    Where frames are missing in between, a shot may well go on with something else, so that is no cut.

    Returns:
        A note on where that is so, if anywhere.

    Raises:
        InputError: there is one; the line says where and how to take one shot of the clip.
    """
    times = part.times.numpy()
    shots, notes = _without_gaps(find_shots(part.small()), times)
    if len(shots) < 2:
        return notes
    cut = shots[1][0]
    more = f" and {len(shots) - 2} more" if len(shots) > 2 else ""
    reason = f"a cut at {times[cut]:.3f} s{more}; a reference is one shot"
    spans = [(float(times[a]), float(times[b])) for a, b in shots[:2] if b > a]
    named = [_part(where, float(times[0]), span).named for span in spans]
    hint = f"take one: {' or '.join(map(shlex.quote, named))}; no cut? #cuts=keep" if named else "no cut? #cuts=keep"
    raise InputError(where.path, f"frame {int(part.index[cut])}", reason, hint)


def _without_gaps(shots: list[tuple[int, int]], times: np.ndarray) -> tuple[list[tuple[int, int]], tuple[str, ...]]:
    """Shots, those joined between which frames are missing by their ``times`` (F,) [s], and a note on where that is."""
    joined, gaps, steps = shots[:1], [], np.diff(times)
    for first, last in shots[1:]:
        gap = float(steps[joined[-1][1] : first].max())
        if gap > GAP * np.median(steps):
            gaps.append(f"{gap:.1f} s without a frame before {times[first]:.3f} s")
            joined[-1] = (joined[-1][0], last)
        else:
            joined.append((first, last))
    if not gaps:
        return joined, ()
    more = f" (and {len(gaps) - 1} more such)" if len(gaps) > 1 else ""
    what = "something else is seen then: taken for one shot (if it is two, take one, #t=START,END)"
    return joined, (f"{gaps[0]}{more}, and {what}",)


def _part(where: ClipSource, first: float, span: tuple[float, float]) -> ClipSource:
    """A shot of ``where``, which begins at ``first`` [s]; a person who was pointed at is, if in that shot."""
    person = where.person
    if isinstance(person, tuple):
        x, y, moment = person
        later = first + moment - span[0]  # counted from the shot's beginning
        person = (x, y, max(0.0, later)) if -_ROUNDED < later < span[1] - span[0] + _ROUNDED else None
    return replace(where, span=span, person=person)


def _changes(before: np.ndarray, after: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One minus correlation, (F,) in [0, 2], and part of the pixels in another bin of colour, (F,) in [0, 1]."""
    change, moved = zip(*(_block_changes(*both) for both in zip(_blocks(before), _blocks(after))))
    return np.concatenate(change), np.concatenate(moved)


def _blocks(small: np.ndarray) -> Iterator[np.ndarray]:
    for start in range(0, len(small), BLOCK):
        yield small[start : start + BLOCK]


def _block_changes(before: np.ndarray, after: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Those of few frames, of which floats are made."""
    moved = np.abs(_histograms(before) - _histograms(after)).sum((1, 2)) / 2 / 3
    return _unlike(before, after), moved


def _unlike(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """One minus correlation of pictures (F, h, w, 3), (F,) in [0, 2]."""
    a, b = (x.reshape(len(x), -1).astype(np.float32) for x in (before, after))
    a, b = a - a.mean(1, keepdims=True), b - b.mean(1, keepdims=True)
    norm = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    return 1 - (a * b).sum(1) / np.maximum(norm, 1e-9)


def _full_range(small: np.ndarray) -> np.ndarray:
    """Small pictures (F, h, w, 3) uint8, each from black to white."""
    low, high = (end(small, axis=(1, 2, 3), keepdims=True) for end in (np.min, np.max))
    return ((small - low) * (255.0 / (high - low))).round().astype(np.uint8)


def _histograms(small: np.ndarray) -> np.ndarray:
    """Part of the pixels in each bin of each colour, (F, 3, BINS)."""
    bins = small.reshape(len(small), -1, 3) // (256 // BINS)
    return np.stack([(bins == b).mean(1) for b in range(BINS)], axis=-1)
