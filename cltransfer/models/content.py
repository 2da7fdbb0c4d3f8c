"""What the answers of a component depend on: the content of its networks and of other files that its options name."""

from __future__ import annotations

import functools
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, fields, is_dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from ..computer.packages import versions
from ..registry.plugin_code import code_of
from ..storage.files import content_hash
from .catalogue import entry_of_file
from .onnx import VARIABLE
from .places import found_model, model_places

READERS = (
    "along_clip", "camera", "clips", "extractors", "feature_shapes", "features", "models", "orientation", "pipeline",
    "placement", "reading", "scenes/person/find_people", "scenes/person/triangulate", "sfm", "skeleton", "subject",
    "trajectory",
)  # fmt: skip
"""Parts of cltransfer by which pictures are read, for :func:`cltransfer.registry.plugin_code.own_code`."""


def read_by() -> list[Any]:
    """Versions of the packages by which pictures are read, and what networks run on."""
    others = {}
    for name in ("numpy", "pycolmap"):
        with suppress(metadata.PackageNotFoundError):
            others[name] = metadata.version(name)
    return [versions(), others, os.environ.get(VARIABLE) or "auto"]


def read_otherwise(told: Sequence[Any]) -> str:
    """What of :func:`read_by` is other here than somewhere else, where it was ``told``; empty where nothing is."""
    here, there = ({**packages, **others, VARIABLE: networks} for packages, others, networks in (read_by(), told))
    apart = [name for name in {**there, **here} if here.get(name) != there.get(name)]
    return "; ".join(f"{name} {here.get(name) or 'absent'}, not {there.get(name) or 'absent'}" for name in apart)


def reading(extractor: Any) -> dict[str, Any]:
    """What an extractor's answers depend on: its options, what its files hold, and its code where it is a plugin."""
    model, files = own_model(extractor), files_content(extractor)
    network = {} if model is None else {"sha256": model_content(model)}
    return {**asdict(extractor), **network, **({"files": files} if files else {}), "code": code_of(extractor)}


def own_model(component: Any) -> str | None:
    """The network that a component names in its option ``model``, None where it has no such option."""
    named = {field.name for field in fields(component)}
    return component.model if "model" in named and isinstance(component.model, str) else None


def files_content(component: Any) -> dict[str, list[str]]:
    """SHA-256 of every file that a plugin's options name, by how it is named there; of several places in order.

    A folder counts where it is named with a slash and is not around the one that we are in: a text is a path by chance.
    What comes with cltransfer names its one file as :func:`own_model`.
    """
    if type(component).__module__.partition(".")[0] == "cltransfer":
        return {}
    found = {}
    for name in sorted(set(_texts(component))):
        places = dict.fromkeys([Path(name), *model_places(name)])
        if contents := [content for place in places if (content := _named_content(name, place))]:
            found[name] = contents
    return found


def _named_content(name: str, place: Path) -> str:
    if os.path.isfile(place):  # no error of a text that can be no path
        return _content(place, place.stat().st_mtime_ns, place.stat().st_size)
    folder = Path(name).name != name and os.path.isdir(place) and not Path.cwd().is_relative_to(place.resolve())
    return content_hash(place) if folder else ""


def _texts(value: Any) -> Iterator[str]:
    """Every text in an option, whatever holds it."""
    if isinstance(value, str | Path):
        yield str(value)
    elif isinstance(value, Mapping):
        yield from _texts(list(value.values()))
    elif isinstance(value, Sequence):
        for item in value:
            yield from _texts(item)
    elif is_dataclass(value):
        yield from _texts([getattr(value, field.name) for field in fields(value)])


def model_content(name: str) -> str:
    """SHA-256 of the network ``name``; empty where there is no such file, so that nothing was read by it.

    A file of the catalogue is not read for it: one of another content is refused before it runs.
    """
    place = found_model(name)
    known = entry_of_file(Path(name).name if place is None else place.name)
    if known is not None and known.sha256:
        return known.sha256
    return "" if place is None else _content(place, place.stat().st_mtime_ns, place.stat().st_size)


@functools.cache
def _content(path: Path, changed: int, size: int) -> str:
    return content_hash(path)
