"""The catalogue of networks and demo assets: what a file is, whose it is, where it is from, what it must contain."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from functools import cache
from importlib.resources import files as package_files
from pathlib import Path, PurePosixPath
from typing import Any, Literal
from urllib.parse import urlsplit

from ..config.layers import read_yaml
from ..errors import CltransferError, InputError, ModelError, UsageError
from ..storage.alone import in_turn
from ..storage.files import cache_dir, read_json, write_json

Kind = Literal["model", "asset"]
VARIABLE = "CLTRANSFER_CATALOGUE"
LARGEST = 4 * 2**30  # bytes of one file

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")
_HASH = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class Entry:
    """One file.

    Args:
        name: what the catalogue calls it.
        kind: model or asset.
        file: its name in the folder; an asset's may lie in one folder more.
        task: what it is for.
        licence: of the weights or the asset.
        source: repository, commit and path, or the address of what it is made from.
        address: http(s) address of the very file, empty where there is none.
        sha256: of the file, empty where it is not known.
        size: of the file [bytes], 0 where it is not known.
        interface: a network's inputs and outputs.
        note: accuracy and speed, and whether anybody ran it.
        made_by: the command that makes the file, where it is not to be had ready.
        group: what is pulled together.
        stands_in_for: the entry whose network this is too, as somebody else made the file; taken where that is missing.
    """

    name: str
    kind: Kind
    file: str
    task: str
    licence: str
    source: str
    address: str = ""
    sha256: str = ""
    size: int = 0
    interface: str = ""
    note: str = ""
    made_by: str = ""
    group: str = ""
    stands_in_for: str = ""

    def __post_init__(self) -> None:
        for key in ("name", "file", "task", "licence", "source"):
            if not getattr(self, key):
                raise ValueError(f"{key} is missing")
        for field in fields(self):
            wanted = int if field.name == "size" else str
            if type(getattr(self, field.name)) is not wanted:
                raise ValueError(f"{field.name} must be {wanted.__name__}, got {getattr(self, field.name)!r}")
        parts = PurePosixPath(self.file).parts
        if len(parts) > (1 if self.kind == "model" else 2) or not all(_NAME.fullmatch(part) for part in parts):
            raise ValueError(f"file must be a plain name, got {self.file!r}")
        if self.address and (
            urlsplit(self.address).scheme not in ("http", "https") or not urlsplit(self.address).netloc
        ):
            raise ValueError(f"address must be http or https, got {self.address!r}")
        if self.sha256 and not _HASH.fullmatch(self.sha256):
            raise ValueError(f"sha256 must be 64 digits 0-9a-f, got {self.sha256!r}")
        if not 0 <= self.size <= LARGEST:
            raise ValueError(f"size must be at most {LARGEST} bytes, got {self.size}")

    @property
    def folder(self) -> Path:
        """Where it is pulled to."""
        return cache_dir() / f"{self.kind}s"

    @property
    def path(self) -> Path:
        """The file it is pulled to."""
        return self.folder / self.file

    @property
    def lock(self) -> Path:
        """What whoever replaces the file holds meanwhile."""
        return cache_dir() / f"{self.path.name}.part.lock"

    def error(self, field: str, reason: str, hint: str = "") -> CltransferError:
        """An error about this file; its exit code tells networks from assets."""
        return (ModelError if self.kind == "model" else InputError)(self.file, field, reason, hint)


def catalogue(kind: Kind, more: Iterable[Path] = ()) -> dict[str, Entry]:
    """Entries by name: ours, those of ``CLTRANSFER_CATALOGUE``, and those of ``more``; hashes pinned before are known.

    Raises:
        UsageError: a file is no catalogue, or gives a name or a file that is taken.
    """
    named = [Path(path) for path in os.environ.get(VARIABLE, "").split(os.pathsep) if path]
    entries = dict(_ours()[kind])
    for path in (*named, *more):
        for name, entry in read_catalogue(path)[kind].items():
            if name in entries or entry.file in {other.file for other in entries.values()}:
                raise UsageError(path, name, "the name or the file is in the catalogue already", "choose another")
            entries[name] = entry
        for name, entry in entries.items():
            if entry.stands_in_for and entry.stands_in_for not in entries:
                raise UsageError(
                    path, f"{name}.stands_in_for", f"no such {kind} in the catalogue: {entry.stands_in_for}"
                )
    return {name: pinned(entry) for name, entry in entries.items()}


def entry_of_file(name: str) -> Entry | None:
    """The network whose file is called ``name``, None if the catalogue has none."""
    return next((entry for entry in catalogue("model").values() if entry.file == name), None)


def stand_ins(name: str) -> list[Entry]:
    """Networks that are taken where there is no file called ``name``, which has no folder in it."""
    known = entry_of_file(name)
    return [] if known is None else [e for e in catalogue("model").values() if e.stands_in_for == known.name]


@cache
def _ours() -> dict[Kind, dict[str, Entry]]:
    return read_catalogue(package_files(__package__).joinpath("catalogue.yaml"))


def read_catalogue(path: Any) -> dict[Kind, dict[str, Entry]]:
    """Entries of a file with the keys ``models`` and ``assets``.

    Raises:
        UsageError: it is missing, or an entry is not as :class:`Entry` says.
    """
    content = read_yaml(path)
    if odd := set(content) - {"models", "assets"}:
        raise UsageError(path, sorted(odd)[0], "expected models and assets")
    return {"model": _entries(path, content, "model"), "asset": _entries(path, content, "asset")}


def _entries(path: Any, content: dict[str, Any], kind: Kind) -> dict[str, Entry]:
    section = content.get(f"{kind}s") or {}
    if not isinstance(section, dict):
        raise UsageError(path, f"{kind}s", "expected a mapping of names to entries")
    known = {field.name for field in fields(Entry)} - {"name", "kind"}
    entries = {}
    for name, values in section.items():
        where = f"{kind}s.{name}"
        if not isinstance(values, dict) or not _NAME.fullmatch(str(name)):
            raise UsageError(path, where, "expected a plain name and a mapping")
        if odd := sorted(set(map(str, values)) - known):
            raise UsageError(path, f"{where}.{odd[0]}", "no such key", f"known: {', '.join(sorted(known))}")
        try:
            entries[str(name)] = Entry(str(name), kind, **values)
        except (TypeError, ValueError) as error:
            raise UsageError(path, where, str(error).removeprefix("Entry.__init__() ")) from None
    return entries


def pinned(entry: Entry) -> Entry:
    """``entry`` with the hash that was accepted for its address before, if its own is not known, or was adopted.

    Raises:
        InputError: ``pins.json`` is damaged.
    """
    if (entry.sha256 and entry.address) or not _pins_file().is_file():
        return entry
    pin = _pins().get(f"{entry.kind}s", {}).get(entry.name, {})
    return replace(entry, sha256=pin["sha256"], size=pin["size"]) if pin.get("address") == entry.address else entry


def pin(entry: Entry, sha256: str) -> Entry:
    """``entry`` with the hash and size of its file, which the user's own ``pins.json`` remembers."""
    size = entry.path.stat().st_size
    with in_turn(_pins_file().with_suffix(".lock")):  # another command may be pinning what it has pulled
        pins = _pins() if _pins_file().is_file() else {}
        section = pins.setdefault(f"{entry.kind}s", {})
        for other in section.values():
            if other.get("file") == entry.file:
                del other["file"]  # which has been replaced by this entry's
        section[entry.name] = {"address": entry.address, "sha256": sha256, "size": size, "file": entry.file}
        write_json(_pins_file(), pins)
    return replace(entry, sha256=sha256, size=size)


def pinned_file(path: Path) -> str:
    """Hash that the network at ``path`` was pulled or adopted with, whoever's catalogue it was of; empty if it was not.

    Raises:
        InputError: ``pins.json`` is damaged.
    """
    if path.parent.resolve() != (cache_dir() / "models").resolve() or not _pins_file().is_file():
        return ""
    return next((pin["sha256"] for pin in _pins().get("models", {}).values() if pin.get("file") == path.name), "")


def _pins() -> dict[str, dict[str, Any]]:
    """What ``pins.json`` holds: by section and name the address, hash and size."""
    content = read_json(_pins_file())
    remedy = "delete the file, then pull with --accept-new or adopt again what is missing"
    if not isinstance(content, dict):
        raise InputError(_pins_file(), "", "expected a mapping of models and assets", remedy)
    for section, pins in content.items():
        if not isinstance(pins, dict):
            raise InputError(_pins_file(), section, "expected a mapping of names", remedy)
        for name, pin in pins.items():
            if not (isinstance(pin, dict) and _is_pin(pin.get("sha256"), pin.get("size"))):
                raise InputError(_pins_file(), f"{section}.{name}", "expected address, sha256 and size", remedy)
    return content


def _is_pin(sha256: object, size: object) -> bool:
    return isinstance(sha256, str) and bool(_HASH.fullmatch(sha256)) and type(size) is int and 0 <= size <= LARGEST


def _pins_file() -> Path:
    return cache_dir() / "pins.json"
