"""Two clips, frame by frame: which frames go together, read alone, and what a reader should know of how."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..errors import InputError
from .clip import Clip
from .cuts import check_one_shot
from .image_folder import FOLDER_RATE, TIMES, image_files
from .letterbox import find_letterbox
from .open_clip import open_part, rate_assumed, without_bars
from .part import find_part
from .source import ClipSource
from .thinned import evenly, nearest

ALIKE = 0.01  # by which two frames' shapes, or what bars leave of them, may differ: a pixel of 100, and rounding

OWN_BARS = "its black bars are not those of the reference and count as picture: #letterbox=crop behind it crops them"

Notes = tuple[str, ...]


@dataclass(frozen=True)
class ClipPairs:
    """Frames of two clips that go together.

    Args:
        reference, render: P frames each.
        original, shown: when each is shown after the first frame of its clip, or of the part that is named, (P,) [s].
    """

    reference: Clip
    render: Clip
    original: Tensor  # (P,)
    shown: Tensor  # (P,)


def open_pairs(asked: ClipSource, found: ClipSource, frames: int | None) -> tuple[ClipPairs, Notes, Notes]:
    """The pairs of a reference and a render, evenly thinned to ``frames``, and notes on either; no other frame is kept.

    Unless asked otherwise a render is scored as it is: one that jumps is a bad render, not two shots, and bars that the
    reference does not have are part of it.

    Raises:
        InputError: a clip is missing or damaged, the reference has a cut, or the two share no moment.
        ResourceError: their frames do not fit in memory.
        UsageError: images a second are named for what has times of its own.
    """
    drawn_as = replace(found, cuts=found.cuts or "keep", letterbox=found.letterbox or "keep")
    original, shown = (find_part(where.path, where.span, where.fps, where.trajectory) for where in (asked, found))
    starts = [part.times - part.times[0] for part in (original, shown)]
    first, second = pairs(starts[0], starts[1])
    notes = (*_one_by_one(found, starts[0]), *_not_scored(starts[0], starts[1], first, frames))
    thin = evenly(starts[1][second], frames)
    first, second = first[thin], second[thin]
    original.check_kept(len(first))  # before every frame is looked at for cuts
    # here, so that it advises what was asked for
    gaps = check_one_shot(asked, original) if asked.cuts != "keep" else ()
    whole = replace(asked, letterbox="keep", cuts="keep")
    (reference, flags), (render, drawn) = open_part(whole, original, first), open_part(drawn_as, shown, second)
    if asked.letterbox != "keep":
        alike = found.letterbox is None and _same_bars(reference, render)
        reference, bars = without_bars(reference)
        flags = (*bars, *flags)
        if alike:
            render, bars = without_bars(render)
            drawn = (*bars, *drawn)
        elif found.letterbox is None and find_letterbox(render.image) != (0, 0, *render.size):
            drawn = (*drawn, OWN_BARS)
    notes = (*notes, *other_shape(reference.size, render.size))
    return ClipPairs(reference, render, starts[0][first], starts[1][second]), (*gaps, *flags), (*drawn, *notes)


def _same_bars(clip: Clip, other: Clip) -> bool:
    """Whether the pictures of two clips fill the same part of their frames, to :data:`ALIKE` of a side."""
    parts = []
    for one in (clip, other):
        left, top, right, bottom = find_letterbox(one.image)
        width, height = one.size
        parts.append(torch.tensor([left / width, top / height, right / width, bottom / height]))
    return bool(((parts[0] - parts[1]).abs() <= ALIKE).all())


def other_shape(reference: tuple[int, int], render: tuple[int, int]) -> Notes:
    """A note where frames of a render are wider or higher than those of the reference; sizes (W, H) [px]."""
    if abs(math.log(reference[0] / reference[1]) - math.log(render[0] / render[1])) <= ALIKE:
        return ()
    sizes = " and ".join(f"{width}x{height}" for width, height in (render, reference))
    return (
        f"its frames and those of the reference, {sizes}, are not of one shape: what fills one does not fill the other",
    )


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
    near = pair_by_time(original, shown)
    apart = (original[near] - shown).abs()
    counts = torch.unique_consecutive(near, return_counts=True)[1]
    kept = torch.stack([same[apart[same].argmin()] for same in torch.arange(len(shown)).split(counts.tolist())])
    if len(original) > 1:
        steps = original.diff()
        outside = (shown <= original[0] - steps[0]) | (shown >= original[-1] + steps[-1])
        kept = kept[~outside[kept]]
    if not len(kept):
        raise InputError("", "times", "the clips share no moment: all frames of one lie before or after the other")
    return near[kept], kept


def _not_scored(original: Tensor, shown: Tensor, first: Tensor, frames: int | None) -> Notes:
    """Notes on frames that have no partner, at times (N,) and (M,) [s].

    ``first`` (P,) of the reference have one; of these pairs ``frames`` are scored, or all.
    """
    count, notes = len(first), []
    thinned = frames is not None and frames < count
    rest = f"{frames} of the pairs are scored (frames={frames})" if thinned else "the others are not scored"
    if count < len(shown):
        ends = f"which has {len(original)} up to {float(original[-1]):.2f} s"
        notes.append(f"{count} of its {len(shown)} frames are paired with frames of the reference, {ends}; {rest}")
    gaps = count <= int(first[-1] - first[0])
    if gaps:
        notes.append(f"{count} of {len(original)} frames of the reference are paired with frames of the render; {rest}")
    steps = [float(times.diff().median()) for times in (original, shown) if len(times) > 1]
    early = float(original[-1] - shown[-1]) > 1.5 * max(steps, default=math.inf)
    if int(first[-1]) < len(original) - 1 and (early or not gaps):  # of less a gap has told
        ends = f"{float(shown[-1]):.2f} s, the reference at {float(original[-1]):.2f} s"
        notes.append(f"ends at {ends}: what comes after is not scored")
    return tuple(notes)


def _one_by_one(render: ClipSource, original: Tensor) -> Notes:
    """A note where ``render`` has an image for each frame of a reference at times (N,) [s], but is paired otherwise."""
    if not rate_assumed(render):
        return ()
    count = len(image_files(render.path))
    played = torch.arange(count).double() / FOLDER_RATE
    if count != len(original) or torch.equal(pair_by_time(original, played), torch.arange(count)):
        return ()
    rate = f"{(count - 1) / float(original[-1]):.4g}"
    asked = f"if its times are meant, name FOLDER#fps={rate} or write a {TIMES}"
    return (f"it has as many images as the reference has frames, {count}: {asked}",)


def pair_by_time(times: Tensor, other: Tensor) -> Tensor:
    """Index (M,) int64 of the nearest of ``times`` (N,) [s] for each of ``other`` (M,) [s]; both increase.

    Raises:
        InputError: the two spans of time do not meet.

    >>> pair_by_time(torch.tensor([0.0, 0.5, 1.0]), torch.tensor([0.1, 0.6, 1.4]))
    tensor([0, 1, 2])
    """
    if times[0] > other[-1] or other[0] > times[-1]:
        spans = " and ".join(f"{float(t[0]):.3f} to {float(t[-1]):.3f} s" for t in (times, other))
        raise InputError("", "times", f"the clips share no moment: {spans}")
    return torch.from_numpy(nearest(times.numpy(), other.numpy()))
