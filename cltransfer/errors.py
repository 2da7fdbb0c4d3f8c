"""Errors a person can act on: one line that says what was expected, what came and what to do."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

LONGEST = 1000  # characters; a name or a value in somebody's file may have any number of them


def shortened(text: object) -> str:
    """``text`` as a line shows it: cut where it is longer than anybody reads."""
    whole = str(text)
    return whole if len(whole) <= LONGEST else f"{whole[:LONGEST]}..."


class CltransferError(Exception):
    """Base of all errors that end a command with one line; ``exit_code`` is what the shell sees.

    >>> str(InputError("scene.ply", "opacity", "property is missing", hint="is it a Gaussian-splat PLY?"))
    'scene.ply: opacity: property is missing (is it a Gaussian-splat PLY?)'
    """

    exit_code = 1

    def __init__(self, where: str | Path, field: str, reason: str, hint: str = "") -> None:
        self.where, self.field, self.reason, self.hint = map(shortened, (where, field, reason, hint))
        line = ": ".join(part for part in (self.where, self.field, self.reason) if part)
        super().__init__(f"{line} ({self.hint})" if self.hint else line)

    def __reduce__(self) -> tuple[type[CltransferError], tuple[str, str, str, str]]:
        return type(self), (self.where, self.field, self.reason, self.hint)  # to be raised in another process


class UsageError(CltransferError):
    """A command or a config that cannot be meant: unknown key, wrong type, value out of range."""

    exit_code = 2


class InputError(CltransferError):
    """A scene, clip or file that cannot be used."""

    exit_code = 3


class ModelError(CltransferError):
    """A network or plugin that is missing, foreign or refused."""

    exit_code = 4


class ResourceError(CltransferError):
    """Memory, disk or a limit of the run."""

    exit_code = 5


@contextmanager
def named(who: str, expected: str) -> Iterator[None]:
    """Anybody's code may run within: what it raises is told in one line, with its name and what was ``expected``.

    >>> with named("extractor mine", "expected features"):
    ...     [][0]
    Traceback (most recent call last):
    cltransfer.errors.ModelError: extractor mine: expected features, it raised IndexError: list index out of range \
(CLTRANSFER_DEBUG=1 shows where)

    Raises:
        ModelError: anything but an error of this module or a lack of memory was raised.
    """
    try:
        yield
    except (CltransferError, MemoryError):
        raise
    except (Exception, SystemExit) as error:  # nobody's component ends the program
        came = f"it raised {type(error).__name__}: {' '.join(str(error).split())}"
        raise ModelError("", who, f"{expected}, {came}", "CLTRANSFER_DEBUG=1 shows where") from error
