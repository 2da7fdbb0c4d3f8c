"""What the configs alone tell of how rows are measured, before the first trial: what nothing measures, or could."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from ..config.layers import origin
from ..errors import UsageError
from ..pipeline.components import SCENE_SOURCE, Components
from ..pipeline.plan import CLIP_SOURCE
from .sweep import Sweep

NAMED = 3  # rows that are named one by one; a grid has hundreds


def check_measurable(sweep: Sweep) -> list[str]:
    """Refuse a loss that the metrics name and that no reading of theirs can ever feed.

    Returns:
        What to tell of such losses that they have of the base or of a preset.

    Raises:
        UsageError: there is one, with the extractors of the rows that would feed it.
    """
    parts, notes = Components.build(sweep.metrics), []
    given = _given(parts)
    for name, loss in parts.losses.items():
        lacking = [feature for feature in loss.requires if feature not in given]
        if not lacking:
            continue
        key = f"metrics.losses.{name}"
        reason = f"needs {lacking[0]!r}, which nothing gives in the metrics"
        feeding = _feeding(sweep, lacking)
        written = _written(extractors=feeding) if feeding else ""
        if key in sweep.origins:
            hint = f"add `{written}`" if written else "add an extractor of it to the metrics"
            raise UsageError(origin(sweep.origins, key), key, reason, f"{hint}, or leave it out")
        notes.append(f"{name} is not measured: it {reason}{f'; `{written}` does' * bool(written)}")
    return notes


def unmeasured(sweep: Sweep, told: Callable[[str], str] = str) -> list[str]:
    """A line for each loss that rows are searched with and the metrics lack, with what measures it.

    Args:
        sweep: the ablation.
        told: how names are written.
    """
    rows: dict[str, list[str]] = {}
    for row in sweep.rows:
        for name in row.config.losses:
            if name not in sweep.metrics.losses:
                rows.setdefault(name, []).append(row.name)
    given, lines = _given(Components.build(sweep.metrics)), []
    for name, searched in rows.items():
        requires = next(row.config for row in sweep.rows if row.name == searched[0]).build("losses")[name].requires
        feeding = _feeding(sweep, [feature for feature in requires if feature not in given])
        hint = f"`{_written(losses=[name], extractors=feeding)}` measures it in every row, and adds it to the total"
        who = "; ".join(searched) if len(searched) <= NAMED else f"{len(searched)} rows, as {searched[0]}"
        lines.append(f"{told(who)}: {told(name)} is not measured; {hint}")
    return lines


def _given(parts: Components) -> set[str]:
    """All features that the extractors of ``parts`` could make of a clip or of what the renderer draws."""
    given = {*CLIP_SOURCE, *SCENE_SOURCE, *parts.renderer.provides}
    waiting = dict(parts.extractors)
    while ready := [name for name, one in waiting.items() if given.issuperset(one.requires)]:
        for name in ready:
            given.update(waiting.pop(name).provides)
    return given


def _feeding(sweep: Sweep, lacking: Iterable[str]) -> list[str]:
    """Extractors of the rows that give any of what is ``lacking``, and that the metrics do not have."""
    wanted = set(lacking)
    built = (item for row in sweep.rows for item in row.config.build("extractors").items())
    found = [name for name, extractor in built if wanted.intersection(extractor.provides)]
    return [name for name in dict.fromkeys(found) if name not in sweep.metrics.extractors]


def _written(**sections: Any) -> str:
    """How an ablation file says that it measures by the components of these ``sections``."""
    said = [f"{section}: {{{', '.join(f'{n}: {{}}' for n in names)}}}" for section, names in sections.items() if names]
    return f"metrics: {{{', '.join(said)}}}"
