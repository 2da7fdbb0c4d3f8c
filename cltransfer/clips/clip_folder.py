"""A folder of clips, which are known by their names."""

from __future__ import annotations

import os
import unicodedata
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from ..errors import InputError, UsageError
from ..storage.run_files import is_run
from .decoding import VIDEOS
from .image_folder import TIMES, natural_order, untimed
from .source import ClipSource

LINKED = "a hard link takes no room either: cp -rl CLIP FOLDER; or copy it, or name its own folder"
FEW = 3  # clips that a note names; of more it says how many


def clips_in(folder: Path) -> dict[str, Path]:
    """Videos, image folders and run folders right inside ``folder``, by name without suffix.

    Raises:
        InputError: there is no such folder, or none in it, or two have one name.
    """
    if not folder.is_dir():
        raise InputError(folder, "clips", "expected a folder" if folder.exists() else "no such folder")
    found: dict[str, Path] = {}
    for entry in sorted(folder.iterdir(), key=lambda entry: natural_order(entry.name)):
        if entry.name.startswith(".") or not _is_clip(entry):
            continue
        name = unicodedata.normalize("NFC", entry.name if entry.is_dir() else entry.stem)  # Macs pack NFD
        if name in found:
            raise InputError(folder, name, "two clips have this name", "clips are matched by name")
        found[name] = entry
    if not found:
        raise InputError(folder, "clips", "expected videos, image folders or runs, found none")
    return found


def refuse_linked(clip: Path) -> None:
    """Refuse a ``clip`` right inside a folder that is a link out of it: nothing is read outside what is named.

    Raises:
        InputError: it is one.
    """
    if _leads_out(clip):
        raise InputError(clip, "", "is a link that leads out of its folder", LINKED)


def _leads_out(clip: Path) -> bool:
    return clip.is_symlink() and not Path(os.path.realpath(clip)).is_relative_to(os.path.realpath(clip.parent))


def _is_clip(entry: Path) -> bool:
    return entry.is_dir() or entry.suffix.lower() in VIDEOS


def sources_in(folder: str | Path) -> dict[str, str]:
    """The clips right inside ``folder`` by name, each as :class:`~cltransfer.clips.source.ClipSource` reads it.

    What stands behind the name of the folder is asked of each of them, as ``#t=0,4&person=1``; of ``#fps=N`` those that
    are images and do not say themselves how fast they play.

    Raises:
        InputError: see :func:`clips_in`.
        UsageError: what stands behind the name is no part of a clip, or a rate, and none of them needs one.
    """
    where = ClipSource.parse(str(folder))
    rate, clips = where.fps, clips_in(where.path)
    asked = {name: rate if _asks(path) else None for name, path in clips.items()}
    if rate is not None and not any(asked.values()):
        raise UsageError(
            folder, "#fps", f"expected folders of images without {TIMES} in it, found none", "leave it out"
        )
    return {name: replace(where, path=path, fps=asked[name]).named for name, path in clips.items()}


def _asks(clip: Path) -> bool:
    """Whether ``clip`` is images that do not say how fast they play; no link out of its folder is looked into."""
    return not _leads_out(clip) and untimed(clip) and not is_run(clip)


def left_over(references: str | Path, methods: Mapping[str, str | Path]) -> list[str]:
    """A note for each folder with what is not scored: clips by whose names there is no reference, and what is no clip.

    Args:
        references: folder of reference clips, as :func:`sources_in` takes it.
        methods: folder of rendered clips by method, likewise.
    """
    folders = {whose: ClipSource.parse(str(named)).path for whose, named in methods.items()}
    whole = ClipSource.parse(str(references)).path
    known = clips_in(whole)
    found = {method: [name for name in clips_in(folder) if name not in known] for method, folder in folders.items()}
    others = {
        whose: [e.name for e in sorted(folder.iterdir()) if not (e.name.startswith(".") or _is_clip(e))]
        for whose, folder in {"references": whole, **folders}.items()
    }
    return [
        *(f"{whose}: {_some(names)} not scored: no reference of this name" for whose, names in found.items() if names),
        *(f"{whose}: {_some(names)} not scored: no video by its suffix" for whose, names in others.items() if names),
    ]


def _some(names: list[str]) -> str:
    """The first few of ``names``, and how many more.

    >>> _some(["a"]), _some(["a", "b", "c", "d"])
    ('a is', 'a, b, c and 1 more are')
    """
    more = f" and {len(names) - FEW} more" if len(names) > FEW else ""
    return f"{', '.join(names[:FEW])}{more} {'is' if len(names) == 1 else 'are'}"
