"""Scores of clips, and where those of a folder lie on disk until all are there, so that a kill loses one."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from .clips.kept_clip import kept_clip, kept_hash
from .clips.source import ClipSource
from .computer.memory import require_parsed
from .config import to_yaml
from .config.options import RunConfig
from .models.content import files_content, read_by, reading
from .pipeline.components import Components
from .registry.plugin_code import code_of, own_code
from .storage.kept_lines import keep, read_kept

KEPT, KEPT_LIMIT = "scores.jsonl", 2**28  # file of scores that were kept, bytes that it may have


@dataclass(frozen=True)
class ClipScore:
    """One clip of one method.

    Args:
        method, clip: names.
        means: raw mean of each term, and of the total, None where undefined.
        defined: frames that have a value, by term.
        frames: of the clip.
        reason: why there is nothing, where nothing could be scored.
        notes: what a reader should know of it.
        lacking: why a term has no value, by term.
        seconds: of the reference, from the first of the frames to the last.
        units: of the means, by term.
        had: terms that the reference has on any frame, whether or not the render has them.
        lasts: whether another run tells no more; see :class:`~cltransfer.features.OfThisRun`.
    """

    method: str
    clip: str
    means: Mapping[str, float | None] = field(default_factory=dict)
    defined: Mapping[str, int] = field(default_factory=dict)
    frames: int = 0
    reason: str = ""
    notes: tuple[str, ...] = ()
    lacking: Mapping[str, str] = field(default_factory=dict)
    seconds: float = 0.0
    units: Mapping[str, str] = field(default_factory=dict)
    had: tuple[str, ...] = ()
    lasts: bool = True


@dataclass(frozen=True)
class Kept:
    """Scores on disk, by what they are of.

    Args:
        path: of the file; None keeps nothing.
        about: what all of them depend on beside their clips.
        known: those that are there, by key.
    """

    path: Path | None
    about: str
    known: Mapping[str, ClipScore]

    @classmethod
    def of(cls, folder: Path | None, parts: Components, config: RunConfig) -> Kept:
        """Those in ``folder``.

        Raises:
            InputError: they are damaged.
            ResourceError: there may not be memory for them.
        """
        if folder is None:
            return cls(None, "", {})
        readers = [[step.name, reading(step.extractor), step.hidden] for step in parts.plan("image").steps]
        losses = [[code_of(loss), files_content(loss)] for loss in parts.losses.values()]
        asked = to_yaml(replace(config, seed=0))  # which is that of the intervals
        about = json.dumps([own_code(), read_by(), losses, asked, readers], default=str)
        lines = read_kept(folder / KEPT, KEPT_LIMIT, _row_of, "score", require_parsed)
        return cls(folder / KEPT, about, dict(lines))

    def key(self, method: str, name: str, reference: str, render: str | None) -> str:
        """What the score of a clip depends on; empty where it is not kept."""
        if self.path is None or render is None:
            return ""
        sources = [kept_clip(ClipSource.parse(clip)) for clip in (reference, render)]
        clips = [[kept_hash(source), replace(source, path=Path()).named] for source in sources]  # wherever they lie
        return hashlib.sha256(json.dumps([self.about, method, name, clips]).encode()).hexdigest()[:32]

    def keep(self, key: str, row: ClipScore) -> None:
        """Put a row on disk, if it has a score that no other run betters and does not lie there."""
        if self.path is not None and key and not row.reason and row.lasts and key not in self.known:
            keep(self.path, {"key": key, **asdict(row)})


def _row_of(line: dict[str, Any]) -> tuple[str, ClipScore]:
    """Key and score of a line.

    Raises:
        TypeError: they are of other kinds of values.
    """
    key = line.pop("key")
    row = ClipScore(**{**line, "notes": tuple(line["notes"]), "had": tuple(line.get("had", ()))})
    texts = [key, row.method, row.clip, row.reason, *row.notes, *row.had, *row.lacking.values(), *row.units.values()]
    numbers = [row.seconds, *(mean for mean in row.means.values() if mean is not None)]
    if not (
        all(isinstance(text, str) for text in texts)
        and all(type(number) in (int, float) and abs(number) <= sys.float_info.max for number in numbers)
        and all(type(count) is int for count in (row.frames, *row.defined.values()))
        and type(row.lasts) is bool
    ):
        raise TypeError
    return key, row
