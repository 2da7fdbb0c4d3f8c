"""How a part of a clip is named: the file, then what to take of it, as in a web page's media fragments."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from .errors import UsageError

KEYS = ("t", "person", "letterbox", "cuts")


@dataclass(frozen=True)
class ClipSource:
    """A clip and what to take of it.

    Args:
        path: video file or image folder.
        span: from when to when, both included [s] after the first frame.
        person: id of the person to follow, 0 the largest; None is the largest.
        letterbox: crop black bars, or keep them.
        cuts: refuse a clip of several shots, or keep it.
    """

    path: Path
    span: tuple[float, float] = (0.0, math.inf)
    person: int | None = None
    letterbox: str = "crop"
    cuts: str = "refuse"

    @classmethod
    def parse(cls, source: str) -> ClipSource:
        """From ``PATH`` or ``PATH#t=START,END&person=ID&letterbox=keep&cuts=keep``, each part optional.

        Raises:
            UsageError: a part is unknown or has no such value.

        >>> ClipSource.parse("clip.mp4#t=1.5,4").span
        (1.5, 4.0)
        """
        name, mark, fragment = source.rpartition("#")
        if not mark or Path(source).exists():
            return cls(Path(source))
        values = {}
        for part in fragment.split("&"):
            key, _, value = part.partition("=")
            if key not in KEYS or key in values:
                raise UsageError(source, f"#{key}", "expected each part once", f"known: {', '.join(KEYS)}")
            values[key] = value
        person = values.get("person")
        if person is not None and not person.isdecimal():
            raise UsageError(source, "#person", f"expected 0 or more, got {person!r}")
        return cls(
            Path(name),
            _span(source, values.get("t", "")),
            None if person is None else int(person),
            _choice(source, "letterbox", values.get("letterbox", "crop"), ("crop", "keep")),
            _choice(source, "cuts", values.get("cuts", "refuse"), ("refuse", "keep")),
        )


def _span(source: str, text: str) -> tuple[float, float]:
    start, _, end = text.partition(",")
    try:
        span = float(start or 0), float(end or math.inf)
    except ValueError:
        span = (math.nan, math.nan)
    if not 0 <= span[0] < span[1]:
        raise UsageError(source, "#t", f"expected START,END in seconds, got {text!r}", "as in clip.mp4#t=1.5,4")
    return span


def _choice(source: str, key: str, value: str, known: tuple[str, ...]) -> str:
    if value not in known:
        raise UsageError(source, f"#{key}", f"expected {' or '.join(known)}, got {value!r}")
    return value
