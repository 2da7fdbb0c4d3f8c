"""What a clip is, in words: per frame and as a whole, as values, JSON and text."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from ..features import Features
from .angle import HEIGHTS, SIDES, STAGINGS, dutch_class, height_class, side_class, staging_class
from .motion import Motion
from .movement import STILL, WORDS, Movement, movement
from .shot_scale import SCALE_NAMES, SCALES, shot_scale

DOUBTFUL = ("dolly zoom", *WORDS["orbit"])  # read from a person who keeps their place before a background that moves
ENDS = 4  # the classes of a clip's first and last quarter say how it begins and ends


@dataclass(frozen=True)
class Track:
    """One property over N frames.

    Args:
        name: of the property.
        classes: its words.
        index: into ``classes``, (N,); -1 where undefined.
        reason: why it is undefined, where it is.
    """

    name: str
    classes: tuple[str, ...]
    index: Tensor  # (N,)
    reason: str = ""

    @property
    def defined(self) -> int:
        """Frames that have a word."""
        return int((self.index >= 0).sum())

    def words(self) -> list[str | None]:
        """The word of each frame, None where undefined."""
        return [self.classes[i] if i >= 0 else None for i in self.index.tolist()]

    def usual(self, start: float = 0.0, stop: float = 1.0) -> str | None:
        """The most frequent word between two parts of the clip, None where it has none."""
        count = len(self.index)
        part = self.index[int(start * count) : max(int(start * count) + 1, round(stop * count))]
        part = part[part >= 0]
        return self.classes[int(part.mode().values)] if len(part) else None


@dataclass(frozen=True)
class Description:
    """A clip in words.

    Args:
        title: what was described.
        times: (N,) [s].
        tracks: scale, height, side, dutch, staging.
        motion: what the camera did from frame to frame.
        movement: what that is called.
        orientation: yaw, pitch, roll as used, (N, 3) [rad].
        flags: what a reader should know.
    """

    title: str
    times: Tensor  # (N,)
    tracks: Mapping[str, Track]
    motion: Motion
    movement: Movement
    orientation: Tensor  # (N, 3)
    flags: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Plain values; what is undefined is null, with a reason."""
        return {
            "format": "cltransfer.description",
            "version": 1,
            "title": self.title,
            "frames": len(self.times),
            "times": self.times.tolist(),
            "text": self.text(),
            "movement": {
                "name": self.movement.name,
                "reason": self.movement.reason,
                "beside": list(self.movement.beside),
                "handheld": self.movement.handheld,
                "net": {name: _rounded(value, 5) for name, value in self.movement.net.items()},
                "unit": "frame sides of apparent motion",
                "shake": _rounded(self.movement.shake, 5),
                "defined": self.motion.read,
                "parallax": _rounded(self.motion.parallax, 4),
            },
            **{name: _track_json(track) for name, track in self.tracks.items()},
            "flags": list(self.flags),
        }

    def text(self) -> str:
        """A few sentences."""
        scale, height, side, dutch, staging = (self.tracks[n] for n in ("scale", "height", "side", "dutch", "staging"))
        seen = f" The person is read in {scale.defined} of {len(self.times)} frames."
        parts = [
            _sentence("Shot size", _from_to(scale), scale.reason),
            _sentence("Angle", _angle(height, side, _canted(dutch, self.movement)), height.reason),
            _sentence("Movement", self.movement.text),
            _sentence("Staging", staging.usual(), staging.reason),
        ]
        return " ".join(parts) + seen


def describe_features(
    title: str, features: Features, times: Tensor, motion: Motion, missing: Mapping[str, str]
) -> Description:
    """Describe N frames.

    Args:
        title: what is described.
        features: with ``keypoints`` and ``orientation``, taken as it is; staging needs ``depth`` and ``layers`` too.
        times: (N,) [s].
        motion: of the camera.
        missing: why a feature is missing, by feature.
    """
    count = len(times)
    orientation = features.require("orientation").double()
    deep = features.has("depth") and features.has("layers")
    staging = staging_class(features) if deep else torch.full((count,), -1)
    no_depth = "" if deep else {**missing, **features.reasons}.get("depth", "no depth")
    tracks = (
        Track("scale", SCALES, shot_scale(features), "too few joints"),
        Track("height", HEIGHTS, height_class(orientation), "the person's orientation is unknown"),
        Track("side", SIDES, side_class(orientation), "the person's orientation is unknown"),
        Track("dutch", ("level", "Dutch"), dutch_class(orientation), "the person's orientation is unknown"),
        Track("staging", STAGINGS, staging, no_depth or "a layer is missing"),
    )
    named = {track.name: track for track in tracks}
    moves = movement(motion)
    return Description(title, times, named, motion, moves, orientation, _flags(motion, moves))


def _flags(motion: Motion, moves: Movement) -> tuple[str, ...]:
    unread = len(motion.times) - motion.read
    flags = [f"the motion of {unread} frames could not be read"] if unread else []
    if not math.isnan(motion.parallax):  # of a camera that is known, nothing is in doubt
        held = [word for word in (moves.name, *moves.beside) if word in DOUBTFUL]
        flags += [f"{word}, or the camera keeps pace with the person: the picture does not tell" for word in held]
    return tuple(flags)


def _rounded(value: float, digits: int) -> float | None:
    return None if math.isnan(value) else round(value, digits)


def _track_json(track: Track) -> dict[str, Any]:
    words = track.words()
    return {
        "usual": track.usual(),
        "defined": track.defined,
        "reason": track.reason if None in words else "",
        "values": words,
    }


def _from_to(scale: Track) -> str | None:
    first, last = scale.usual(0, 1 / ENDS), scale.usual(1 - 1 / ENDS, 1)
    if first is None or last is None or first == last:
        return _spelled(scale.usual())
    return f"{_spelled(first)}, then {_spelled(last)}"


def _spelled(scale: str | None) -> str | None:
    return None if scale is None else SCALE_NAMES[SCALES.index(scale)]


def _canted(dutch: Track, moves: Movement) -> str:
    """Dutch if the clip is, or if the camera rolls there: at either end a person may just lean."""
    ends = (dutch.usual(0, 1 / ENDS), dutch.usual(1 - 1 / ENDS, 1))
    rolls = abs(moves.net["roll"]) > STILL and "Dutch" in ends
    return "Dutch" if rolls or dutch.usual() == "Dutch" else ""


def _angle(height: Track, side: Track, canted: str) -> str | None:
    if height.usual() is None:
        return None
    return ", ".join(filter(None, (height.usual(), _from(side.usual()), canted)))


def _from(side: str | None) -> str:
    return f"from the {side}" if side in ("front", "back") else f"from {side}" if side else ""


def _sentence(name: str, words: str | None, reason: str = "") -> str:
    return f"{name}: {words or f'not told ({reason})'}."
