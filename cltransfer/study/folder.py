"""Where a study lies: a page is known by its mark, and no key is lost to another study."""

from __future__ import annotations

from pathlib import Path

from ..errors import UsageError
from ..storage.files import check_out
from .design import Study

INDEX = "index.html"
MARK = "cltransfer study"
HEAD = 4096  # bytes of a page within which its mark stands


def key_of(out: Path) -> Path:
    """The key of the page in ``out``, beside it."""
    return out.parent / f"{out.name}.key.json"


def check_page(out: Path) -> None:
    """Refuse a folder that holds something else than a page of a study.

    Raises:
        UsageError: it is no folder, or neither empty nor a page that was made here.
    """
    check_out(out)
    if out.is_dir() and any(out.iterdir()) and not _is_page(out / INDEX):
        raise UsageError(out, "--out", "is neither empty nor a page of a study", "name another folder")


def _is_page(index: Path) -> bool:
    if not index.is_file():
        return False
    with index.open("rb") as stream:
        return f'content="{MARK}"'.encode() in stream.read(HEAD)


def check_key(out: Path, study: Study) -> None:
    """Refuse to replace the key of another study, without which the answers to it are worth nothing.

    Raises:
        UsageError: the key beside ``out`` is that of another study.
        InputError: it is no key.
    """
    key = key_of(out)
    if key.exists() and (name := Study.load(key).name) != study.name:
        reason = f"is the key of another study, {name}, whose answers need it"
        raise UsageError(key, "--out", reason, "name another folder, or move that key away")
