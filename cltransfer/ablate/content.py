"""What a trial's outcome depends on, by its content: scenes, references, plugins and networks, wherever they lie."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..clips.decoding import IMAGE_SUFFIXES
from ..clips.kept_clip import kept_clip, kept_hash
from ..clips.source import ClipSource
from ..config.options import SECTIONS, RunConfig
from ..errors import InputError, UsageError
from ..models.content import files_content, model_content, own_model
from ..models.places import found_model
from ..reading.scene_source import split_scene
from ..registry.declared import BUILTIN
from ..registry.plugin_code import code_of
from ..scenes.builtin import read_name
from ..scenes.foreign import reader_code
from ..scenes.load import ANIMATED, load_scene
from ..scenes.meshes.moment import MARK, split_moment
from ..storage.files import content_hash
from ..storage.run_files import LABELS, SUBJECT, is_run

Digest = Callable[[str | None], str]
Content = Callable[[Path, bool], str]
MADE_OF_FILES = (".yaml", ".yml", ".gltf", ".obj")  # scenes that name other files


def parts_content(config: RunConfig) -> list[list[Any]]:
    """Code of the plugins and content of the networks and files that a config names."""
    return [
        [code_of(part), model_content(own_model(part) or ""), *files_content(part).items()] for part in _built(config)
    ]


def read_here(config: RunConfig, parts: list[list[Any]], networks: bool) -> list[list[Any]]:
    """Of :func:`parts_content` the files that plugins' options name, and the ``networks`` that are here, if read.

    What is not here counts as empty, where it is known by the catalogue elsewhere.
    """
    here = [networks and found_model(own_model(part) or "") is not None for part in _built(config)]
    return [[model if there else "", *files] for there, (_, model, *files) in zip(here, parts, strict=True)]


def codes_of(*configs: RunConfig) -> tuple[str, ...]:
    """Code of the plugins that configs name, as it was imported here."""
    return tuple(sorted({code_of(part) for config in configs for part in _built(config)} - {""}))


def _built(config: RunConfig) -> list[Any]:
    return [part for section in SECTIONS for part in config.build(section).values()]


def plugin_codes() -> tuple[str, ...]:
    """The code of every component of a plugin that is registered here, as it was imported."""
    classes = [cls for known in SECTIONS.values() for cls in known.registered().values()]
    return tuple(sorted({code_of(cls) for cls in classes} - {""}))


def _content(path: Path, posed: bool) -> str:
    """SHA-256 of a file or folder and of what goes with it: parts of a scene, labels of a person, a plugin's reader.

    Of a folder that is a clip or a run it is that of what is played of it, of any other and of ``posed`` images that of
    all that lies in it. Links that lead out of it are not followed.
    """
    if path.is_dir():
        clip = is_run(path) or any(file.suffix.lower() in IMAGE_SUFFIXES for file in path.iterdir())
        return kept_hash(kept_clip(ClipSource(path))) if clip and not posed else _of_all(path)
    if path.suffix.lower() in MADE_OF_FILES:
        return load_scene(path).digest
    labels = path.with_name(LABELS)
    beside = content_hash(labels) if path.name == SUBJECT and labels.is_file() else ""
    return content_hash(path) + beside + reader_code(path)


def _of_all(folder: Path) -> str:
    home = folder.resolve()
    inside = (file for file in folder.rglob("*") if file.is_file() and file.resolve().is_relative_to(home))
    return content_hash(folder, inside)


def digest(source: str | None, content: Content = _content) -> str:
    """What identifies a scene or a reference: a built-in name, or the content of its files.

    Args:
        source: as it is named.
        content: what identifies a file or folder, and whether that is a set of posed images.

    Raises:
        InputError: a file is missing, or an image of a clip is a link that leads out of its folder.
        UsageError: a part of a clip, or a moment of a scene, is none.
    """
    if source is None or source == "auto":
        return str(source)
    split = split_scene(source)
    if split is None:
        return _of_one(source, content)
    person = Path(split[1]).with_name(SUBJECT)  # as it is read
    parts = [_of_one(part, content) for part in split]
    return "@".join([*parts, content(person, False)] if person.is_file() else parts)


def _of_one(source: str, content: Content) -> str:
    path = Path(source)
    if path.exists():
        return content(path, False)
    if source.startswith(BUILTIN):
        return _builtin(source.removeprefix(BUILTIN))
    if Path(source.rpartition(MARK)[0]).suffix.lower() in ANIMATED:  # SCENE#t=SECONDS&animation=NAME
        scene, moment = split_moment(source)
        if scene.exists():
            return f"{content(scene, False)}#{moment}"
    clip = ClipSource.parse(source)  # CLIP#PART
    if clip.path.exists():
        part = replace(clip, path=Path())
        return content(clip.path, False) + f"#{part}" * (part != ClipSource(Path()))
    file, there, index = source.rpartition(":")  # SET:INDEX
    if there and Path(file).exists():
        return f"{content(Path(file), True)}:{index}"
    raise InputError(path, "", "no such file")


def _builtin(name: str) -> str:
    """A built-in scene by all that its name may leave out, any other name as it is."""
    try:
        scene, seed, form = read_name(name)
    except UsageError:
        return f"{BUILTIN}{name}"
    return f"{BUILTIN}{scene}-{seed}-{form}"


def digests() -> Digest:
    """:func:`digest` that reads no file twice; for one sweep, as files may be edited before the next."""
    return functools.partial(digest, content=functools.cache(_content))
