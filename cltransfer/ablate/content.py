"""What a trial's outcome depends on, by its content: scenes, references, plugins and networks, wherever they lie."""

from __future__ import annotations

import functools
from pathlib import Path

from ..config_options import SECTIONS, RunConfig
from ..errors import InputError
from ..files import content_hash
from ..onnx import model_content
from ..registry import code_of
from ..scenes.foreign import reader_of
from ..scenes.lifted import LABELS, SUBJECT
from ..scenes.load import load_scene

MADE_OF_FILES = (".yaml", ".yml", ".gltf", ".obj")  # scenes that name other files


def parts_content(config: RunConfig) -> list[list[str]]:
    """Code of the plugins and content of the networks that a config names."""
    built = [part for section in SECTIONS for part in config.build(section).values()]
    return [[code_of(part), model_content(part.model) if hasattr(part, "model") else ""] for part in built]


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
    """SHA-256 of a file or folder and of what goes with it: parts of a scene, labels of a person, a plugin's reader."""
    if path.suffix.lower() in MADE_OF_FILES:
        return load_scene(path).digest
    labels, reader = path.with_name(LABELS), reader_of(path)
    beside = content_hash(labels) if path.name == SUBJECT and labels.is_file() else ""
    return content_hash(path) + beside + ("" if reader is None else code_of(reader))
