"""What a journal's answers depend on: whether a run may go on with it, and what is told where it may not."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path

from ..errors import InputError

VIEW = "the view of init"  # what a file holds that --init names
PERSON = "person"  # who was lifted, or whom the file holds that --subject names
ASKED = ("init", "subject", "scene", "reference", "part of the reference", "threads")  # what a command says, as config.
UPGRADED = ("versions", "code of cltransfer")  # from which it follows who is lifted where nobody is named
OF_A_COMPUTER = (*UPGRADED, "threads", "config.threads", "networks run on", "unread of the reference")
PRESET = "config.preset"  # from which other settings follow
NAMED = 3  # settings that are named where several differ
_DIGEST = re.compile("[0-9a-f]{32,}")


def compare(path: Path, recorded: object, header: Mapping[str, object]) -> None:
    """Hold what a journal was begun with against the ``header`` of the run that is to go on with it.

    Raises:
        InputError: it is no header, or another; the line names the setting that differs, and what to do.
    """
    now = json.loads(json.dumps(header))
    if not isinstance(recorded, dict):
        raise InputError(path, "header", "not a journal")
    others = [key for key in sorted({*now, *recorded}, key=_rank) if recorded.get(key) != now.get(key)]
    for given, follows in (("init", VIEW), ("subject", PERSON)):
        if given in others:
            others = [key for key in others if key != follows]
    for key in others[:1]:
        before, here = recorded.get(key), now.get(key)
        reason = f"the run was begun with {_said(before)}, this is {_said(here)}"
        if all(isinstance(value, str) and _DIGEST.fullmatch(value) for value in (before, here)):
            reason = "is not what the run was begun with"
        raise InputError(path, key, reason, _begun_so(key, before, others[1:]))


def same_command(recorded: object, header: Mapping[str, object]) -> bool:
    """Whether a journal was begun by the command of ``header``: what it says, and what the files that it names held.

    What is of a computer, or was not there in another version, is not said: by another the run cannot go on, but it is
    the same one.
    """
    if not isinstance(recorded, dict):
        return False
    now = json.loads(json.dumps(header))
    others = {key for key in recorded.keys() & now.keys() if recorded[key] != now[key]}
    follows = {PERSON} if others & {*UPGRADED} else set()
    return others <= {*OF_A_COMPUTER, *follows}


def _rank(key: str) -> tuple[bool, bool, str]:
    """By which settings are told: the preset, what else a command says, and last what follows or was installed."""
    return key != PRESET, not (key.startswith("config.") or key in ASKED), key


def _begun_so(key: str, value: object, more: Sequence[str] = ()) -> str:
    """How the run is gone on with, or begun anew; the settings in ``more`` differ too."""
    again = "start over with another --out"
    if more:
        named = [*more[:NAMED], *([f"{len(more) - NAMED} more"] if len(more) > NAMED else [])]
        listed = " and ".join(filter(None, (", ".join(named[:-1]), named[-1])))
        differ = "differs" if len(more) == 1 else "differ"
        return f"{listed} {differ} too: repeat the command as it was with --resume, or {again}"
    if key == "threads":
        word = f"CLTRANSFER_THREADS={shlex.quote(str(value))}"
    elif key == "init" or (key == "subject" and value is not None):
        word = f"--{key} {shlex.quote(str(value))}"
    elif key == "subject":
        word = "no --subject"
    elif key.startswith("config.") and (value is None or isinstance(value, str | int | float)):
        said = value if isinstance(value, str) else _said(value)
        word = shlex.quote(f"{key.removeprefix('config.')}={said}")
    elif key.startswith("config."):
        return f"repeat the command as it was with --resume, or {again}"
    else:
        return again
    return f"go on with {word}, or {again}"


def _said(value: object) -> str:
    """A setting as a config says it.

    >>> _said(None), _said(True), _said("auto")
    ('null', 'true', "'auto'")
    """
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    return repr(value)
