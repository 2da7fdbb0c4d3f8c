"""Rows of an ablation that are a grid: every combination of some keys' values, each called by what it says."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

from ..config.layers import merge, nest
from ..config.options import RunConfig
from ..errors import UsageError
from ..registry.typed import IN_QUOTES, nearest, shown

AXES = "axes"
MOST = 200  # rows of a file with axes: each runs on every case
LISTED = "as losses.framing.weight: [5, 10]"


def with_axes(written: Mapping[str, Any], where: Any) -> dict[str, Any]:
    """What is ``written`` in an ablation file, its axes made rows below those that it names.

    >>> with_axes({"axes": {"lod": [1, 2], "losses.framing": [None]}}, "")["rows"]
    {'lod=1, losses.framing=null': {'lod': 1, 'losses': {'framing': None}}, 'lod=2, losses.framing=null': {'lod': 2,
    'losses': {'framing': None}}}

    Raises:
        UsageError: axes are no lists of values by key, a key is none of a row or stands under another, a value or a
            row's name is there twice, or there are more than :data:`MOST` rows.
    """
    found = dict(written)
    if AXES not in found:
        return found
    axes, rows = _checked(found.pop(AXES), where), found.get("rows") or {}
    if not isinstance(rows, Mapping):
        return found  # told where rows are read
    if (count := len(rows) + math.prod(map(len, axes.values()))) > MOST:
        hint = "leave out values, or split them over several files"
        raise UsageError(where, AXES, f"make {count} rows, expected {MOST} at most", hint)
    made = dict(rows)
    for values in itertools.product(*axes.values()):
        name = ", ".join(f"{key}={_said(value)}" for key, value in zip(axes, values))
        if name in made:
            raise UsageError(where, f"rows.{name}", "axes make a row of this name too", "give it another name")
        made[name] = functools.reduce(merge, map(nest, axes, values))
    return {**found, "rows": made}


def _checked(axes: Any, where: Any) -> dict[str, Sequence[Any]]:
    if not isinstance(axes, Mapping) or not axes:
        raise UsageError(where, AXES, f"expected keys with their values, got {shown(axes)}", LISTED)
    known = [*(f.name for f in fields(RunConfig)), "scene"]
    for key, values in axes.items():
        if not isinstance(key, str):
            raise UsageError(where, AXES, f"keys are text, got {shown(key)}", IN_QUOTES)
        at = f"{AXES}.{key}"
        if (first := key.partition(".")[0]) not in known:
            raise UsageError(where, at, "no such key", nearest(first, known))
        if not all(key.split(".")):
            raise UsageError(where, at, "expected names with points between them", LISTED)
        if not isinstance(values, list) or not values:
            raise UsageError(where, at, f"expected a list of one value or more, got {shown(values)}", LISTED)
        said = [_said(value) for value in values]
        if twice := next((text for text in said if said.count(text) > 1), None):
            raise UsageError(where, at, f"expected each value once, {twice} is there twice")
        if above := next((other for other in axes if key.startswith(f"{other}.")), None):
            raise UsageError(where, at, f"stands under {above}, which is an axis too", "say both in the values of one")
    return dict(axes)


def _said(value: Any) -> str:
    """A value as YAML writes it in a list, on one line: no comma in it is taken for one between two axes."""
    import yaml

    text = yaml.safe_dump([value], default_flow_style=True, sort_keys=False, width=math.inf, allow_unicode=True)
    return text.strip()[1:-1]
