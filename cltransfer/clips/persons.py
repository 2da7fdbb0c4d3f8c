"""The persons of a clip, and the one that is followed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import UsageError

BRIEF = 2  # frames of a track, up to which nobody was followed
FEW = 8  # of a list, shown
MORE = "more frames=, or #t=START,END"  # of the clip
CROSSING = 0.3  # overlap with another person from which it is not certain who is who


@dataclass(frozen=True)
class Spot:
    """A place in a frame that a person covers.

    Args:
        frame: index.
        x, y: from the top left in [0, 1] of the frame.
        size: of the frame (W, H) [px].
        other: the frame on the other side of the moment that is meant; None where ``frame`` shows that moment.
    """

    frame: int
    x: float
    y: float
    size: tuple[int, int]
    other: int | None = None


Who = int | Spot | None  # id, where the person is seen, or the largest


@dataclass(frozen=True)
class Persons:
    """Every person of a clip.

    Args:
        boxes: x, y, width, height [px], score of each person in each frame, (P, N, 5), the largest person first;
            NaN where it is not seen.
        jumps: frames in which the person's box does not overlap the one before, by person.
        lost: frames in which one of two who touch is not seen any more, by person: the other may be the one who is.
        back: frames in which a person who was alone is seen again after long, by person.
        gathered: whether the largest person is only the largest of each frame, because nobody so large could be
            followed.
    """

    boxes: np.ndarray  # (P, N, 5)
    jumps: tuple[tuple[int, ...], ...]
    lost: tuple[tuple[int, ...], ...]
    back: tuple[tuple[int, ...], ...]
    gathered: bool = False

    def follow(self, who: Who, clip: str | Path = "") -> tuple[np.ndarray, tuple[str, ...]]:
        """Boxes (N, 5) of one person, and what a reader should know; ``clip`` is named where there is none.

        Raises:
            UsageError: there is no such person.
        """
        count, frames = self.boxes.shape[:2]
        if count == 0 and who in (None, 0):
            return np.full((frames, 5), np.nan), ()
        chosen = self.at(who, clip) if isinstance(who, Spot) else who or 0
        if chosen >= count:
            known = f"expected 0 to {count - 1}: {count} persons are seen"
            few = {0: "nobody is seen", 1: "only person 0 is seen in this clip"}
            raise UsageError(clip, f"#person={who}", few.get(count, known))
        seen = np.isfinite(self.boxes[..., 0])
        flags = []
        if isinstance(who, Spot) and who.other is not None:
            frames_read = f"frames {min(who.frame, who.other)} and {max(who.frame, who.other)}"
            flags.append(
                f"the moment of the click lies between {frames_read}: who is there in frame {who.frame} is taken"
            )
        if count > 1:
            rest = [f"{i} in {n} frames" for i, n in enumerate(seen.sum(1).tolist()) if i != chosen]
            others = ", ".join(rest[:FEW]) + f" and {len(rest) - FEW} more" * (len(rest) > FEW)
            flags.append(f"person {chosen} is followed, seen in {seen[chosen].sum()} frames; also seen: {others}")
        if self.gathered and chosen == 0:
            flags.append(f"the largest person could not be followed: the largest of each frame is taken ({MORE})")
        elif unclear := self._unclear(chosen):
            flags.append(f"somebody as large whom nothing follows is in frames {_listed(unclear)} ({MORE})")
        crossed = [i for other in range(count) if other != chosen for i in self._crossings(chosen, other)]
        crossed += self.lost[chosen]
        if crossed:
            flags.append(f"persons overlap in frames {_listed(crossed)}: who is who is not certain")
        if self.jumps[chosen]:
            flags.append(f"the person jumps in frames {_listed(self.jumps[chosen])}: it may be another")
        if self.back[chosen]:
            flags.append(
                f"after long the person is seen again in frames {_listed(self.back[chosen])}: it may be another"
            )
        return self.boxes[chosen], tuple(flags)

    def at(self, spot: Spot, clip: str | Path = "") -> int:
        """Who covers ``spot``; of several the one whose box is smallest, for a person before another hides less.

        Raises:
            UsageError: nobody does, or somebody else does in its other frame.
        """
        found = self._over(spot, spot.frame)
        if found is None:
            x, y, width, height = (self.boxes[:, spot.frame, :4] / np.tile(spot.size, 2)).T
            corners = np.stack([x, x + width, y, y + height], axis=1)
            seen = [i for i in range(len(x)) if np.isfinite(x[i])]
            known = "; ".join("person {}, x {:.2f} to {:.2f}, y {:.2f} to {:.2f}".format(i, *corners[i]) for i in seen)
            where = f"nobody at {spot.x:g},{spot.y:g} of frame {spot.frame}"
            raise UsageError(clip, "#person", where, f"seen there: {known or 'nobody'}")
        other = None if spot.other is None else self._over(spot, spot.other)
        if other is not None and other != found:
            who = f"person {found} in frame {spot.frame} and person {other} in frame {spot.other}"
            hint = f"#person={found} or #person={other} says who is meant"
            raise UsageError(
                clip, "#person", f"no frame is read at that moment, and {spot.x:g},{spot.y:g} shows {who}", hint
            )
        return found

    def _over(self, spot: Spot, frame: int) -> int | None:
        """Who covers a place in a ``frame``, None where nobody does."""
        x, y, width, height = (self.boxes[:, frame, :4] / np.tile(spot.size, 2)).T
        over = (x <= spot.x) & (spot.x <= x + width) & (y <= spot.y) & (spot.y <= y + height)  # NaN is not over
        return int(np.where(over, width * height, np.inf).argmin()) if over.any() else None

    def _unclear(self, chosen: int) -> list[int]:
        """Frames without ``chosen`` but with one about as large who is seen briefly only; none where they are few."""
        seen = np.isfinite(self.boxes[..., 0])
        area = self.boxes[..., 2] * self.boxes[..., 3]
        brief = area[seen.sum(1) <= BRIEF] > np.nanmedian(area[chosen]) / 2  # NaN is not
        frames = np.flatnonzero(brief.any(0) & ~seen[chosen]).tolist()
        return frames if len(frames) > max(BRIEF, len(seen[0]) / 10) else []

    def _crossings(self, first: int, second: int) -> list[int]:
        both = np.isfinite(self.boxes[[first, second], :, 0]).all(0)
        over = [
            overlap(self.boxes[first, i : i + 1], self.boxes[second, i : i + 1])[0, 0] for i in np.flatnonzero(both)
        ]
        return np.flatnonzero(both)[np.array(over) > CROSSING].tolist() if over else []


def overlap(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Intersection over union (P, Q) in [0, 1] of boxes (P, 4 or more) and (Q, 4 or more) as x, y, width, height."""
    a, b = first[:, None], second[None]
    low = np.maximum(a[..., :2], b[..., :2])
    high = np.minimum(a[..., :2] + a[..., 2:4], b[..., :2] + b[..., 2:4])
    shared = (high - low).clip(0).prod(-1)
    return shared / np.maximum(a[..., 2:4].prod(-1) + b[..., 2:4].prod(-1) - shared, 1e-9)


def _listed(frames: Sequence[int]) -> str:
    """Frame numbers, the first few.

    >>> _listed([3, 1, 4])
    '1, 3, 4'
    """
    known = sorted(set(frames))
    return ", ".join(map(str, known[:FEW])) + f" and {len(known) - FEW} more" * (len(known) > FEW)
