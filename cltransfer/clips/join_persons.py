"""Who is who along a clip: boxes of all persons joined into tracks, each looked for where the person was going."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from .persons import BRIEF, Persons, overlap

RATE = 24.0  # frames a second of a clip without times
OVERLAP = 0.1  # least intersection over union of one person with where it was going
HIDDEN = 0.3  # overlap by which one who was seen in the last frame goes before one who was not
MAX_GAP = 1.0  # [s] a person may be unseen and still be taken for the same, or one frame if that is longer
LONGEST = 5.0  # [s] the same of one who was alone and comes back alone
SOON = 0.35  # [s] after which who was not seen must be as large as before
SIMILAR = 2.5  # factor by which the area of such a person may differ
ALIKE = 4.0  # factor by which the area of a person may change in one frame
REACH = 4.0  # heights a second that a person may move in the picture and be found again without overlap
CLEAR = 2.0  # factor by which anybody else must be farther from there
WINDOW = 0.5  # [s] over which a person's velocity is taken
FEWEST = 3  # boxes that it is taken of at least, where the frames are far apart
MOST = 9  # boxes that it is taken of at most: 36 pairs
LATEST = 3  # boxes of which the median says where a person was last
ROUGH = 0.03  # of a box's sides together, below which it is off by the detector and not by the person
AHEAD = 2.0  # how far ahead it is believed, in terms of how long it was seen
KEPT = 1000  # largest tracks that are told of: 80 MB in the longest clip, where a crafted one could need gigabytes
WAY = 9  # places that are looked at between where a person was seen last and would be now


@dataclass(eq=False)
class Track:
    """One person so far, not finished.

    Args:
        seen: box (5,) by frame, in order.
        jumps, lost, back: see :class:`Persons`.
    """

    seen: dict[int, np.ndarray] = field(default_factory=dict)
    jumps: list[int] = field(default_factory=list)
    lost: list[int] = field(default_factory=list)
    back: list[int] = field(default_factory=list)

    @property
    def last(self) -> int:
        """The frame in which it was seen last."""
        return next(reversed(self.seen))

    def way(self, i: int, times: np.ndarray) -> np.ndarray:
        """Boxes (WAY, 5) from where it was seen last to where it is in frame ``i`` if it went on."""
        known = self._lately(times)
        boxes = np.array([self.seen[frame] for frame in known])
        speed = slope(times[known], boxes[:, :2] + boxes[:, 2:4] / 2)
        since = times[known[0]] - times[known]  # (K,) [s]
        end = boxes[0].copy()
        if len(known) >= LATEST:
            carried = boxes[:LATEST].copy()
            carried[:, :2] += since[:LATEST, None] * speed
            smooth = np.median(carried, axis=0)
            if np.abs(smooth - end)[:2].max() < ROUGH * end[2:4].sum():
                end = smooth
        end[:2] += speed * min(times[i] - times[self.last], AHEAD * since[-1])
        return boxes[0] + np.linspace(0, 1, WAY)[:, None] * (end - boxes[0])

    def may_be(self, i: int, times: np.ndarray, boxes: np.ndarray) -> np.ndarray:
        """Which of ``boxes`` (B, 5) in frame ``i`` are as large as they need to be after that time, (B,) bool."""
        if self.last == i - 1 or times[i] - times[self.last] <= SOON:
            return np.ones(len(boxes), bool)
        return self.alike(boxes)

    def alike(self, boxes: np.ndarray) -> np.ndarray:
        """Which of ``boxes`` (B, 5) are about as large as it was last, (B,) bool."""
        return np.abs(np.log(boxes[:, 2:4].prod(1) / self.seen[self.last][2:4].prod())) < np.log(SIMILAR)

    @property
    def weight(self) -> float:
        """Score times area over all frames [px^2]."""
        return sum(float(box[2:5].prod()) for box in self.seen.values())

    def _lately(self, times: np.ndarray) -> list[int]:
        """The frames that tell where it goes, the last one first."""
        known: list[int] = []
        for frame in reversed(self.seen):
            if len(known) >= FEWEST and times[frame] < times[self.last] - WINDOW:
                break
            known.append(frame)
        kept = np.linspace(0, len(known) - 1, min(len(known), MOST)).round().astype(int)
        return [known[k] for k in kept]


def slope(times: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Velocity (2,) of ``places`` (N, 2) at ``times`` (N,): the median over all pairs, which no few odd boxes change.

    >>> slope(np.array([0.0, 1, 2, 3]), np.array([[0.0, 0], [2, 0], [9, 9], [6, 0]])).tolist()
    [2.0, 0.0]
    """
    first, second = np.triu_indices(len(times), 1)
    if len(first) == 0:
        return np.zeros(2)
    return np.median((places[second] - places[first]) / (times[second] - times[first])[:, None], axis=0)


def join(found: Sequence[np.ndarray], times: np.ndarray | None = None) -> Persons:
    """Persons of the boxes (P_i, 5) that were found in each of N frames.

    A box belongs to the track that it overlaps most where that was going, or on the way there, seen at most
    ``MAX_GAP`` ago. What is left goes to the track nearest by, where that is clear and it is about as large, which is
    noted as a jump. A person who is alone in two neighbouring frames is the same at any distance, which is a jump too,
    and so is one who is alone before and after ``LONGEST`` without anybody, if place and size fit.

    Args:
        found: as x, y, width, height [px], score.
        times: of the frames, (N,) [s], increasing; None takes ``RATE`` a second.
    """
    times = np.arange(len(found)) / RATE if times is None else times
    tracks: list[Track] = []
    for i, boxes in enumerate(found):
        recent = [track for track in tracks if i - track.last <= 2 or times[i] - times[track.last] <= MAX_GAP]
        pairs = _paired(recent, boxes, i, times)
        near = _near(recent, pairs, boxes, i, times)
        pairs |= near
        for track in near.values():
            track.jumps.append(i)
        if not pairs and (alone := _alone(recent, found, i)):
            pairs = {0: alone}
            alone.jumps.append(i)
        if not pairs and (back := _back(tracks, found, i, times)):
            pairs = {0: back}
            back.back.append(i)
        _note_lost(recent, pairs, boxes, i)
        for b, box in enumerate(boxes):
            if b not in pairs:
                tracks.append(Track())
            pairs.get(b, tracks[-1]).seen[i] = box
    return _persons(tracks, len(found))


def _paired(tracks: list[Track], boxes: np.ndarray, i: int, times: np.ndarray) -> dict[int, Track]:
    """Track of each box of frame ``i`` that has one: of one where a track was going, or else on its way."""
    if not tracks or len(boxes) == 0:
        return {}
    ways = np.concatenate([track.way(i, times) for track in tracks])
    shared = overlap(ways, boxes).reshape(len(tracks), WAY, len(boxes))
    shared *= np.stack([track.may_be(i, times, boxes) for track in tracks])[:, None]
    hidden = np.array([track.last < i - 1 for track in tracks])
    pairs = _most(shared[:, -1], hidden)
    left = shared.max(1)
    left[list(pairs.values())] = left[:, list(pairs)] = 0
    return {b: tracks[t] for b, t in {**pairs, **_most(left, hidden)}.items()}


def _most(shared: np.ndarray, hidden: np.ndarray) -> dict[int, int]:
    """Track of each box that has one, so that the overlaps (T, B) add up to the most; ``hidden`` (T,) go behind."""
    from scipy.optimize import linear_sum_assignment

    fits = shared >= OVERLAP
    cost = np.where(fits, HIDDEN * hidden[:, None] - shared, HIDDEN)  # none fits at more than it costs not to
    rows, columns = linear_sum_assignment(cost)
    return {int(b): int(t) for t, b in zip(rows, columns) if fits[t, b]}


def _near(
    recent: list[Track], pairs: dict[int, Track], boxes: np.ndarray, i: int, times: np.ndarray
) -> dict[int, Track]:
    """Track of each box without one that is clearly nearest to where somebody, missed once at most, was or went.

    Frames that were thinned may lie more than a person's width apart.
    """
    tracks = [track for track in recent if track.last >= i - 2 and track not in pairs.values()]
    free = [b for b in range(len(boxes)) if b not in pairs]
    if not tracks or not free:
        return {}
    centres = boxes[free, :2] + boxes[free, 2:4] / 2
    far = np.full((len(tracks), len(free)), np.inf)
    for row, track in zip(far, tracks):
        ends = track.way(i, times)[[0, -1]]
        distance = np.linalg.norm((ends[:, :2] + ends[:, 2:4] / 2)[:, None] - centres, axis=-1).min(0)
        reach = REACH * (times[i] - times[track.last]) * ends[0, 2:4].max()
        fits = (distance <= reach) & track.alike(boxes[free])
        row[fits] = distance[fits]
    clear = {}
    for t, b in np.argwhere(np.isfinite(far)):
        rivals = np.concatenate([np.delete(far[t], b), np.delete(far[:, b], t)])
        if (rivals >= CLEAR * far[t, b]).all():
            clear[free[b]] = tracks[t]
    return clear


def _alone(recent: list[Track], found: Sequence[np.ndarray], i: int) -> Track | None:
    """Whoever was alone in the last frame, if one is alone in frame ``i`` and about as large."""
    if i == 0 or len(found[i]) != 1 or len(found[i - 1]) != 1:
        return None
    ratio = found[i][0, 2:4].prod() / found[i - 1][0, 2:4].prod()
    return next(track for track in recent if track.last == i - 1) if 1 / ALIKE < ratio < ALIKE else None


def _back(tracks: list[Track], found: Sequence[np.ndarray], i: int, times: np.ndarray) -> Track | None:
    """Whoever was alone before nobody was seen, if one alone in frame ``i`` can be the same."""
    last = max((track.last for track in tracks), default=i)
    if len(found[i]) != 1 or len(found[last]) != 1 or not MAX_GAP < times[i] - times[last] <= LONGEST:
        return None
    track = next(track for track in tracks if track.last == last)
    fits = track.may_be(i, times, found[i]).all() and overlap(track.way(i, times), found[i]).max() >= OVERLAP
    return track if fits else None


def _note_lost(recent: list[Track], pairs: dict[int, Track], boxes: np.ndarray, i: int) -> None:
    """Note in which tracks one of two who touch is not seen any more from frame ``i``."""
    gone = [track for track in recent if track.last == i - 1 and track not in pairs.values()]
    for track, b in itertools.product(gone, pairs):
        if overlap(track.seen[i - 1][None], boxes[b][None]).item() > 0:
            track.lost.append(i)
            pairs[b].lost.append(i)


def _gathered(tracks: list[Track], count: int) -> Track | None:
    """The largest of each frame who are in tracks of up to ``BRIEF`` frames, where they are more than any one track.

    A large person who could not be followed must not give way to a small one who could. None where they are seen in no
    more than half of ``count`` frames.
    """
    largest: dict[int, np.ndarray] = {}
    for track in tracks:
        for frame, box in track.seen.items():
            if len(track.seen) <= BRIEF and box[2:5].prod() > largest.get(frame, np.zeros(5))[2:5].prod():
                largest[frame] = box
    whole = Track(dict(sorted(largest.items())))
    more = all(whole.weight > track.weight for track in tracks)
    return whole if more and len(largest) > max(BRIEF, count / 2) else None


def _persons(tracks: list[Track], count: int) -> Persons:
    """Finished tracks of ``count`` frames, the ``KEPT`` largest, those first."""
    whole = _gathered(tracks, count)
    if whole is not None:
        for track in tracks:
            track.seen = {frame: box for frame, box in track.seen.items() if box is not whole.seen.get(frame)}
        tracks = [whole, *(track for track in tracks if track.seen)]
    order = sorted(tracks, key=lambda track: -track.weight)[:KEPT]
    boxes = np.full((len(order), count, 5), np.nan)
    for row, track in zip(boxes, order):
        row[list(track.seen)] = list(track.seen.values())
    jumps, lost, back = (tuple(tuple(getattr(t, name)) for t in order) for name in ("jumps", "lost", "back"))
    return Persons(boxes, jumps, lost, back, whole is not None)
