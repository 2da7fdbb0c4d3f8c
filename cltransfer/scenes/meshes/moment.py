"""When an animated scene is looked at, and how that is written: ``man.glb#t=0.6``, ``man.glb#t=2&animation=Run``."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import parse_qsl

from ...errors import UsageError

MARK = "#"


@dataclass(frozen=True)
class Moment:
    """When an animated file is looked at.

    Args:
        time: [s].
        animation: its name; None is the first.
    """

    time: float = 0.0
    animation: str | None = None

    def __str__(self) -> str:
        return f"t={self.time:g}" + ("" if self.animation is None else f"&animation={self.animation}")


START = Moment()


def split_moment(source: str | Path) -> tuple[Path, Moment | None]:
    """The file of ``source``, and the moment that is written behind it as in Media Fragments (W3C), if any.

    A file whose own name holds the mark is taken as it is.

    Raises:
        UsageError: what stands behind the mark is no moment.

    >>> split_moment("walk.glb#t=1.5&animation=Walk")[1]
    Moment(time=1.5, animation='Walk')
    """
    name, mark, text = str(source).rpartition(MARK)
    if not mark or Path(source).exists():
        return Path(source), None
    hint = f"expected FILE{MARK}t=SECONDS or FILE{MARK}t=SECONDS&animation=NAME"
    try:
        values: dict[str, str] = dict(parse_qsl(text, keep_blank_values=True, strict_parsing=True))
        time = float(values.pop("t", "0"))
    except ValueError:
        values, time = {}, math.nan
    animation = values.pop("animation", None)
    if not text or values or not (math.isfinite(time) and time >= 0):
        raise UsageError(name, f"{MARK}{text}", "is no moment", hint)
    return Path(name), Moment(time, animation)
