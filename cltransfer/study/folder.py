"""Where a study's key lies: beside its page, and none is lost to another study."""

from __future__ import annotations

from pathlib import Path

from ..errors import UsageError
from .design import Study

MARK = "cltransfer study"


def key_of(out: Path) -> Path:
    """The key of the page in ``out``, beside it."""
    return out.parent / f"{out.name}.key.json"


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
