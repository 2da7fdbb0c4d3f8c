"""Which files a transfer is told to read."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ..clips.source import ClipSource
from ..reading.scene_source import split_scene
from ..registry.declared import BUILTIN
from ..scenes.meshes.moment import split_moment
from ..storage.run_files import LABELS, SUBJECT
from .inputs import Inputs


def named_files(inputs: Inputs) -> Iterator[Path]:
    """Files and folders that ``inputs`` name, and what is read beside them; there or not.

    Raises:
        UsageError: what stands behind a clip or an animated scene is no part of it.
    """
    if isinstance(inputs.scene, str):
        yield from _of_scene(inputs.scene)
    yield from _of_reference(inputs.reference)
    if inputs.init != "auto":
        path, colon, index = inputs.init.rpartition(":")
        yield Path(path if colon and index.isdecimal() else inputs.init)
    if isinstance(inputs.subject, Path):
        yield from (inputs.subject, inputs.subject.parent / LABELS)


def _of_scene(source: str) -> Iterator[Path]:
    if not source.startswith(BUILTIN):
        yield split_moment(source)[0]


def _of_reference(source: str) -> Iterator[Path]:
    if (split := split_scene(source)) is not None:
        scene, trajectory = split[0], Path(split[1])
        yield from _of_scene(scene)
        yield from (trajectory, trajectory.parent / SUBJECT, trajectory.parent / LABELS)
    elif not source.startswith(BUILTIN):
        yield ClipSource.parse(source).path
