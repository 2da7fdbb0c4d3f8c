"""How a part of a clip is named: the file, then what to take of it, as in a web page's media fragments."""

from __future__ import annotations

import math
import shlex
from dataclasses import dataclass
from pathlib import Path

from torch import Tensor

from ..errors import UsageError
from .persons import Spot, Who

_ROUNDED = 0.01  # [s]
_STAYS = 0.1  # [s] in which nobody leaves the place where they are seen
_RATES = (0.001, 1000.0)  # images a second: videos that are written keep milliseconds
KEYS = ("t", "person", "letterbox", "cuts", "fps")


@dataclass(frozen=True)
class ClipSource:
    """A clip and what to take of it.

    Args:
        path: video file or image folder.
        span: from when to when, both included [s] after the first frame.
        person: id of the person to follow, 0 the largest; or a place that the person covers, as x and y from the top
            left in [0, 1] of the frame as it is read, and the moment [s] in the part that is read; None is the largest.
        letterbox: crop black bars, or keep them; None keeps them in a render that is scored, and crops any other clip.
        cuts: refuse a clip of several shots, or keep it; None keeps a render that is scored, and refuses any other.
        fps: images a second of a folder that has no ``times.json``; None takes 24, which is told.
        trajectory: what tells when the frames of a run's video are shown; None leaves that to the clip.
    """

    path: Path
    span: tuple[float, float] = (0.0, math.inf)
    person: int | tuple[float, float, float] | None = None
    letterbox: str | None = None
    cuts: str | None = None
    fps: float | None = None
    trajectory: Path | None = None

    @classmethod
    def parse(cls, source: str) -> ClipSource:
        """From ``PATH`` or ``PATH#t=START,END&person=ID&letterbox=keep&cuts=keep&fps=N``, each part optional.

        A person is an id, or a place as in ``person=0.4,0.6`` (in the first frame) or ``person=0.4,0.6,1.5``.

        Raises:
            UsageError: a part is unknown or has no such value, or stands behind a ``#`` of its own.

        >>> ClipSource.parse("clip.mp4#t=1.5,4").span
        (1.5, 4.0)
        """
        name, fragment = _parted(source)
        if not fragment:
            return cls(Path(name))
        _check_joined(source, name, fragment)
        values = {}
        for part in fragment.split("&"):
            key, _, value = part.partition("=")
            if key not in KEYS or key in values:
                wrong = "expected each part once" if key in values else "unknown part"
                raise UsageError(source, f"#{key}", wrong, f"known: {', '.join(KEYS)}")
            values[key] = value
        return cls(
            Path(name),
            _span(source, values.get("t", "")),
            _person(source, values["person"]) if "person" in values else None,
            _choice(source, "letterbox", values.get("letterbox"), ("crop", "keep")),
            _choice(source, "cuts", values.get("cuts"), ("refuse", "keep")),
            _rate(source, values["fps"]) if "fps" in values else None,
        )

    @property
    def named(self) -> str:
        """How it is named, as :meth:`parse` reads it; times to a millisecond.

        >>> ClipSource(Path("a/clip.mp4"), (1.5, 4), letterbox="keep").named
        'a/clip.mp4#t=1.500,4.000&letterbox=keep'
        """
        start, end = self.span
        whole = (start, end) == (0, math.inf)
        values = {
            "t": None if whole else f"{start:.3f},{end:.3f}" if end < math.inf else f"{start:.3f}",
            "person": ",".join(f"{v:.6g}" for v in self.person) if isinstance(self.person, tuple) else self.person,
            "letterbox": self.letterbox,
            "cuts": self.cuts,
            "fps": None if self.fps is None else f"{self.fps:.9g}",
        }
        parts = [f"{key}={value}" for key, value in values.items() if value is not None]
        return f"{self.path}#{'&'.join(parts)}" if parts else str(self.path)

    def who(self, times: Tensor, size: tuple[int, int]) -> Who:
        """Whom to follow in frames at ``times`` (N,) [s] of ``size`` (W, H) [px].

        Raises:
            UsageError: the moment lies after the last frame.
        """
        if not isinstance(self.person, tuple):
            return self.person
        x, y, moment = self.person
        if moment > float(times[-1]) + _ROUNDED:
            reason = f"expected up to {float(times[-1]):.3f} s, where the frames that are read end, got {moment:g}"
            raise UsageError(self.path, "#person", reason)
        nearest = int((times - moment).abs().argmin())
        off = moment - float(times[nearest])
        other = nearest + (1 if off > 0 else -1)
        between = abs(off) > _STAYS and 0 <= other < len(times)
        return Spot(nearest, x, y, size, other if between else None)


def unnamed(source: str) -> tuple[str, str]:
    """A clip's name without the part of it, and that part without its person, as ``t=1.5,4&`` or empty.

    >>> unnamed("clip.mp4#t=1.5,4&person=1")
    ('clip.mp4', 't=1.5,4&')
    """
    name, fragment = _parted(source)
    kept = [part for part in fragment.split("&") if part and not part.startswith("person=")]
    return name, "".join(f"{part}&" for part in kept)


def _parted(source: str) -> tuple[str, str]:
    """A clip's name, and what is asked of it; empty where the whole is the name of a file."""
    name, mark, fragment = source.rpartition("#")
    return (name, fragment) if mark and not Path(source).exists() else (source, "")


def _check_joined(source: str, name: str, fragment: str) -> None:
    """Refuse a ``name`` that is no file and ends in a part, before the ``#`` of another."""
    file, mark, part = name.rpartition("#")
    if mark and part.partition("=")[0] in KEYS and not Path(name).exists():
        hint = f"join parts by &: {shlex.quote(f'{file}#{part}&{fragment}')}"
        raise UsageError(source, "#", "expected one # before all parts, got several", hint)


def _person(source: str, text: str) -> int | tuple[float, float, float]:
    if text.isdecimal():
        return int(text)
    try:
        x, y, moment = (float(part) for part in (text if text.count(",") == 2 else f"{text},0").split(","))
    except ValueError:
        x = y = moment = math.nan
    if not (0 <= x <= 1 and 0 <= y <= 1 and 0 <= moment < math.inf):
        reason = f"expected an id, or X,Y or X,Y,SECONDS with X and Y in [0, 1], got {text!r}"
        raise UsageError(source, "#person", reason, "`cltransfer inspect` shows where to click")
    return x, y, moment


def _span(source: str, text: str) -> tuple[float, float]:
    start, _, end = text.partition(",")
    try:
        span = float(start or 0), float(end or math.inf)
    except ValueError:
        span = (math.nan, math.nan)
    if not 0 <= span[0] < span[1]:
        raise UsageError(source, "#t", f"expected START,END in seconds, got {text!r}", "as in clip.mp4#t=1.5,4")
    return span


def _rate(source: str, text: str) -> float:
    least, most = _RATES
    try:
        rate = float(text)
    except ValueError:
        rate = math.nan
    if not least <= rate <= most:
        reason = f"expected images a second, {least:g} to {most:g}, got {text!r}"
        raise UsageError(source, "#fps", reason, "as in FOLDER#fps=30")
    return rate


def _choice(source: str, key: str, value: str | None, known: tuple[str, ...]) -> str | None:
    if value is not None and value not in known:
        raise UsageError(source, f"#{key}", f"expected {' or '.join(known)}, got {value!r}")
    return value
