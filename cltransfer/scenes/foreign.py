"""Scenes of a representation that a plugin brings: its renderer reads the file and draws what it has read."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from ..errors import ModelError, named
from ..registry import RENDERERS
from ..registry.plugin_code import code_of
from ..storage.files import check_size
from .geometry import Geometry, lacking


def own_suffixes() -> list[str]:
    """Suffixes that the allowed plugins read, sorted."""
    return sorted({suffix for cls in RENDERERS.registered().values() for suffix in getattr(cls, "suffixes", ())})


def reader_of(path: Path) -> type[Any] | None:
    """The renderer, of an allowed plugin, that reads files of this suffix; None where there is none.

    Raises:
        ModelError: there are several.
    """
    suffix = path.suffix.lower()
    found = {name: cls for name, cls in RENDERERS.registered().items() if suffix in getattr(cls, "suffixes", ())}
    if len(found) > 1:
        who = " and ".join(sorted(found))
        raise ModelError(
            path, "", f"{suffix} is read by renderers {who}, expected one", "allow only one of the plugins"
        )
    return next(iter(found.values()), None)


def reader_code(path: Path) -> str:
    """SHA-256 of the plugin's code that reads files of this suffix, empty where none does.

    Raises:
        ModelError: several do.
    """
    reader = reader_of(path)
    return "" if reader is None else code_of(reader)


def read_foreign(path: Path, reader: type[Any]) -> Geometry:
    """What ``reader`` reads in the file ``path``.

    Raises:
        InputError: it is missing, or the plugin says that it is damaged.
        ModelError: the plugin fails, or what it gives is no geometry.
    """
    check_size(path, sys.maxsize)
    who = f"renderer {RENDERERS.name_of(reader)}"
    with named(f"{path}: {who}", "expected a geometry from read"):
        geometry: Geometry = reader.read(path)
    check_geometry(path, who, geometry)
    return geometry


def check_geometry(where: str | Path, who: str, geometry: Any) -> None:
    """Refuse what is no :class:`~cltransfer.scenes.geometry.Geometry`; ours have checked themselves.

    Raises:
        ModelError: it lacks something.
    """
    if type(geometry).__module__.startswith("cltransfer."):
        return
    with named(f"{where}: {who}", "expected a geometry"):
        found = lacking(geometry, RENDERERS.names())
        if not found and (again := lacking(geometry.with_label(geometry.label), RENDERERS.names())):
            found = f"after with_label {again}"
    if found:
        raise ModelError(where, who, f"expected a geometry, got {found}", "see cltransfer/scenes/geometry.py")
