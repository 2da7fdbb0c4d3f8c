"""Which file the name of a network means, and making it mean one."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from ..errors import ModelError, UsageError
from ..storage.alone import in_turn
from ..storage.files import atomic, cache_dir, check_size, content_hash
from .catalogue import LARGEST, Entry, entry_of_file, pin, stand_ins


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


def adopt(entry: Entry, file: Path) -> Entry:
    """``entry`` with a copy of ``file`` at ``entry.path``, which is the one it means from now on, on this computer.

    Whoever makes a network of what its authors publish gets other bytes with every version of the tools.

    Raises:
        UsageError: the entry has an address, where the very file is to be had; or another file of its name is found
            before the copy would be.
        InputError: there is no such file, or it is too large.
    """
    if entry.address:
        raise UsageError("", entry.name, f"is published, at {entry.address}", "expected one to be made; pull this one")
    check_size(file, LARGEST)
    first = next((place for place in model_places(entry.file) if place.is_file()), entry.path)
    if first.resolve() != entry.path.resolve() and content_hash(first) != content_hash(file):
        reason = "is another file, and is found before the one in the cache"
        raise UsageError(first, entry.name, reason, "remove or rename it")
    with in_turn(entry.lock):  # lest the pin is of what another command puts there
        with atomic(entry.path) as temporary:
            shutil.copyfile(file, temporary)
        return pin(entry, content_hash(entry.path))
