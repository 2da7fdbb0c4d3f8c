"""The folder of a fit: whose it is, and the levels of detail that are done."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ..errors import InputError, UsageError
from ..storage.files import check_out, read_json, write_json
from ..storage.unfinished import holds_others, left_in
from ._curve import Level

STATE = "fit.json"
WRITTEN = re.compile(r"fit\.json|curve\.(csv|svg)|splats\.ply|(grid|level_\d+)\.safetensors")  # by fits of ours


def check_folder(folder: Path) -> None:
    """Refuse a folder that holds something else than a fit, before any work is done for it.

    Raises:
        UsageError: it is no folder, or neither empty nor a fit.
    """
    check_out(folder)
    if holds_others(folder, WRITTEN) and not (folder / STATE).is_file():
        raise UsageError(folder, "--out", f"is neither empty nor a fit, it has no {STATE}", "name another folder")


def begun(folder: Path, key: Mapping[str, Any], scene: str) -> list[Level]:
    """Levels done in ``folder`` by the fit that ``key`` names; nothing is written.

    A folder in which another fit has left nothing but its fit.json, as one that ended before its first look does, is
    as a new one.

    Args:
        folder: of the fit.
        key: what the fit is known by.
        scene: name of the file of what was fitted, there as soon as a level is done.

    Raises:
        UsageError: the folder holds another fit, or something else.
        InputError: its fit.json is damaged, or the scene is gone.
    """
    check_folder(folder)
    if not (folder / STATE).is_file():
        return []
    state = read_json(folder / STATE)
    try:
        if {name: state.get(name) for name in key} == key:
            return _with_scene(folder, [Level(**level) for level in state["levels"]], scene)
        there = set(folder.iterdir()) - set(left_in(folder, WRITTEN))
        if state.get("levels") == [] and there == {folder / STATE}:
            return []
    except (AttributeError, KeyError, TypeError):
        raise InputError(folder / STATE, "", "is not the state of a fit", "choose another folder") from None
    raise UsageError(folder, "--out", "holds a fit with other options or views", "choose another folder")


def _with_scene(folder: Path, levels: list[Level], scene: str) -> list[Level]:
    if levels and not (folder / scene).is_file():
        raise InputError(
            folder / scene, "", f"no such file, {STATE} has {len(levels)} levels of it", f"delete {folder}"
        )
    return levels


def write_state(folder: Path, key: Mapping[str, Any], levels: Sequence[Level]) -> None:
    """Write fit.json: what the fit is known by, and its levels that are done."""
    write_json(folder / STATE, {**key, "levels": [asdict(level) for level in levels]})
