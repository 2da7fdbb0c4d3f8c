"""Which file the name of a network means."""

from __future__ import annotations

import os
from pathlib import Path

from ..errors import ModelError
from ..storage.files import cache_dir
from .catalogue import entry_of_file, stand_ins


def model_places(name: str) -> list[Path]:
    """Where the network ``name`` is looked for: the folders of ``CLTRANSFER_MODELS``, then the cache.

    A name with a folder in it (``weights/depth.onnx``) is taken as it stands.
    """
    if Path(name).name != name:
        return [Path(name)]
    named = os.environ.get("CLTRANSFER_MODELS", "").split(os.pathsep)
    folders = [Path(folder) for folder in named if folder] + [cache_dir() / "models"]
    return [folder / name for folder in folders]


def find_model(name: str) -> Path:
    """File of the network ``name``, at the first of :func:`model_places` that has it, or one that stands in for it.

    Raises:
        ModelError: there is no such file; the line says what to get and where to put it.
    """
    found = found_model(name)
    if found is not None:
        return found
    places = model_places(name)
    known = next(iter(stand_ins(name)), entry_of_file(Path(name).name))
    if known is None:
        raise ModelError(name, "model", "no such file", f"put it in {places[0].parent}")
    digest = f" with sha256 {known.sha256}" if known.sha256 else ""
    accept = "" if known.sha256 else " --accept-new"
    get = f"cltransfer models pull {known.group or known.name}{accept}" if known.address else known.made_by
    what = f"no such file, nor {known.file}" if known.file != Path(name).name else "no such file"
    what += f"{digest} ({known.licence}, from {known.source})"
    # what is pulled, or made and adopted, is found by its name alone
    then = "" if Path(name).name == name else f"then write model={known.file}, "
    raise ModelError(name, "model", what, f"run: {get}; {then}or put {known.file} in {places[0].parent}")


def found_model(name: str) -> Path | None:
    """The file that ``name`` means; a name with a folder in it means itself."""
    others = [entry.file for entry in stand_ins(name)]
    places = [place for file in (name, *others) for place in model_places(file)]
    return next((place for place in places if place.is_file()), None)
