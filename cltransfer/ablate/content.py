"""What a trial's outcome depends on, by its content: scenes, references, plugins and networks, wherever they lie."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

from ..config_options import SECTIONS, RunConfig
from ..errors import InputError
from ..files import content_hash
from ..onnx import files_content, model_content, own_model
from ..registry import code_of
from ..scenes.lifted import LABELS, SUBJECT
from ..scenes.load import load_scene

MADE_OF_FILES = (".yaml", ".yml", ".gltf", ".obj")  # scenes that name other files


def parts_content(config: RunConfig) -> list[list[Any]]:
    """Code of the plugins and content of the networks and files that a config names."""
    built = [part for section in SECTIONS for part in config.build(section).values()]
    return [[code_of(part), model_content(own_model(part) or ""), *files_content(part).items()] for part in built]


def digest(source: str | None) -> str:
    """What identifies a scene or a reference: a built-in name, or the content of its files.

    Raises:
        InputError: a file is missing.
    """
    if source is None or source == "auto":
        return str(source)
    path = Path(source)
    if path.exists():
        return _content(path)
    if "@" in source:
        scene, _, trajectory = source.rpartition("@")
        person = Path(trajectory).with_name(SUBJECT)  # as it is read
        return "@".join([digest(scene), digest(trajectory), *([_content(person)] if person.is_file() else [])])
    if source.startswith("builtin:"):
        return source
    for mark in "#:":  # CLIP#PART, SET:INDEX
        file, there, part = source.rpartition(mark)
        if there and Path(file).exists():
            return f"{_content(Path(file))}{mark}{part}"
    raise InputError(path, "", "no such file")


@functools.cache
def _content(path: Path) -> str:
    """SHA-256 of a file or folder and of the files that go with it: parts of a scene, labels of a person."""
    if path.suffix.lower() in MADE_OF_FILES:
        return load_scene(path).digest
    labels = path.with_name(LABELS)
    return content_hash(path) + (content_hash(labels) if path.name == SUBJECT and labels.is_file() else "")
