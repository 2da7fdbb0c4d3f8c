"""The camera's motion in words: which primitive leads, which go with it, and whether a hand holds the camera."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from .motion import APPARENT, PRIMITIVES, Motion

STILL = 0.009  # apparent motion over the clip below which nothing moves [frame sides]
BESIDE = 0.6  # part of the leading motion that another needs to be named beside it
SHAKY = 0.022  # back and forth, per second, from which a hand holds the camera [frame sides / s]
RESTLESS = 2.0  # back and forth over the net motion from which holding is all the camera does, or going and coming back
HOLDS = 2.0  # [s] whose back and forth is held against the net motion, which does not grow with the clip as that does
TURNS = 3  # of all motions that go back and forth, from which it shakes: a move that comes back turns once
ALSO = 0.15  # of what goes back and forth most, from which another motion counts among them
SLACK = 0.05  # of its range that a motion has to go back for a turn
COMPENSATED = 0.4  # the lesser of dolly and zoom over the greater from which they are a dolly zoom
CRASH = 1.2  # log size a second from which a zoom is a crash zoom
WHIP = 1.1  # frame sides a second from which a pan is a whip pan

WORDS = {
    "pan": ("pan right", "pan left"),
    "tilt": ("tilt up", "tilt down"),
    "roll": ("roll clockwise", "roll counterclockwise"),
    "zoom": ("zoom in", "zoom out"),
    "dolly": ("push in", "pull out"),
    "truck": ("truck right", "truck left"),
    "boom": ("boom up", "boom down"),
    "orbit": ("orbit right", "orbit left"),
}


@dataclass(frozen=True)
class Movement:
    """What the camera does in a clip.

    Args:
        name: the leading motion: one of :data:`WORDS`, dolly zoom, crash zoom, whip pan, static or handheld; None where
            no motion was read.
        beside: motions that go with it, the largest first.
        handheld: whether it shakes as a hand does; None where no motion was read.
        net: apparent motion from first to last frame by primitive [frame sides]; NaN where none was read.
        shake: motion back and forth [frame sides / s]; NaN where none was read.
        reason: why there is no name.
        returns: whether the camera comes back from where the leading motion has led it.
    """

    name: str | None
    beside: tuple[str, ...]
    handheld: bool | None
    net: dict[str, float]
    shake: float
    reason: str = ""
    returns: bool = False

    @property
    def text(self) -> str:
        """In words."""
        if self.name is None:
            return f"not told ({self.reason})"
        name = f"{self.name} and back" if self.returns else self.name
        words = " with ".join([name, " and ".join(self.beside)]) if self.beside else name
        return f"{words}, handheld" if self.handheld and self.name != "handheld" else words


def movement(motion: Motion) -> Movement:
    """The movement that ``motion`` makes."""
    if motion.read < 2:  # the first frame has none before it
        reason = "one frame does not move" if len(motion.times) == 1 else "no frame's motion could be read"
        return Movement(None, (), None, dict.fromkeys(PRIMITIVES, math.nan), math.nan, reason)
    track = _filtered(motion.track)
    net = track[-1] - track[0]
    duration = max(float(motion.times[-1] - motion.times[0]), 1e-9) if len(motion.times) > 1 else 1.0
    back = (track.diff(dim=0).abs().sum(0) - net.abs()).clamp_min(0)  # (P,), back and forth by primitive
    wasted = float(back.sum())
    shake = wasted / duration
    handheld = shake > SHAKY and wasted > 2 * STILL and _restless(track[:, back > ALSO * back.max()])
    order = net.abs().argsort(descending=True).tolist()
    largest = float(net[order[0]].abs())
    named = dict(zip(PRIMITIVES, net.tolist()))
    if handheld and min(wasted, HOLDS * shake) > RESTLESS * largest:
        return Movement("handheld", (), True, named, shake)
    if not handheld and (word := _returning(track, largest)):
        return Movement(word, (), False, named, shake, returns=True)
    if largest < STILL:
        return Movement("static", (), handheld, named, shake)
    lead = _lead(PRIMITIVES[order[0]], motion, named)
    spent = {"zoom", "dolly"} if lead == "dolly zoom" else {PRIMITIVES[order[0]]}
    beside = [p for p in (PRIMITIVES[i] for i in order) if p not in spent and abs(named[p]) > BESIDE * largest]
    return Movement(lead, tuple(_word(p, named[p]) for p in beside), handheld, named, shake)


def _returning(track: Tensor, largest: float) -> str:
    """Where motions (N, P) lead that go far beyond where they end, at most ``largest`` away; empty if none do."""
    away = track - track[0]
    farthest = away.abs().amax(0)
    if float(farthest.max()) <= max(RESTLESS * largest, 2 * STILL):
        return ""
    most = int(farthest.argmax())
    there = dict(zip(PRIMITIVES, away[away[:, most].abs().argmax()].tolist()))
    return "dolly zoom" if _compensates(PRIMITIVES[most], there) else _word(PRIMITIVES[most], there[PRIMITIVES[most]])


def _restless(track: Tensor) -> bool:
    """Whether motions (N, P) turn back more often than those of a camera that comes back once, in sum.

    Against its own mean speed one that comes part of the way back turns as it starts and ends too.
    """
    steady = torch.linspace(0, 1, len(track), dtype=track.dtype)[:, None] * (track[-1] - track[0])
    seen, about = (sum(turns(column) for column in way.T) for way in (track, track - steady))
    return seen >= TURNS or about > TURNS


def turns(track: Tensor) -> int:
    """How often a motion (N,) turns back by more than :data:`SLACK` of its range.

    >>> turns(torch.tensor([0.0, 1.0, 2.0, 1.0, 0.0])), turns(torch.tensor([0.0, 1.0, 2.0, 1.95, 3.0]))
    (1, 0)
    """
    slack = SLACK * float(track.max() - track.min())
    count, sign, extreme = 0, 0, float(track[0])
    for value in track.tolist():
        if sign and sign * (value - extreme) >= 0:
            extreme = value  # it goes on
        elif abs(value - extreme) > slack:  # it turns, or begins
            count, sign, extreme = count + (sign != 0), 1 if value > extreme else -1, value
    return count


def _lead(primitive: str, motion: Motion, net: dict[str, float]) -> str:
    if _compensates(primitive, net):
        return "dolly zoom"
    if primitive == "zoom" and _fastest(motion, "zoom") > CRASH:
        return "crash zoom"
    if primitive == "pan" and _fastest(motion, "pan") > WHIP:
        return "whip pan"
    return _word(primitive, net[primitive])


def _compensates(primitive: str, net: dict[str, float]) -> bool:
    """Whether the zoom takes back what the dolly does to the person's size, and ``primitive`` is one of them."""
    dolly, zoom = net["dolly"], net["zoom"]
    together = min(abs(dolly), abs(zoom)) > COMPENSATED * max(abs(dolly), abs(zoom))
    return primitive in ("dolly", "zoom") and together and dolly * zoom < 0


def _fastest(motion: Motion, primitive: str) -> float:
    """Largest rate of ``primitive`` per second."""
    if len(motion.times) < 2:
        return 0.0
    column = PRIMITIVES.index(primitive)
    steps = _filtered(motion.track)[:, column].diff().abs() / APPARENT[column]
    return float((steps / _filtered(motion.times[:, None])[:, 0].diff()).max())  # so that what is steady stays so


def _word(primitive: str, amount: float) -> str:
    return WORDS[primitive][0 if amount >= 0 else 1]


def _filtered(track: Tensor) -> Tensor:
    """Mean over three frames, ends kept: what is read jumps a little from frame to frame."""
    if len(track) < 3:
        return track
    return torch.cat([track[:1], (track[:-2] + track[1:-1] + track[2:]) / 3, track[-1:]])
