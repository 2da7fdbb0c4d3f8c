"""Options that several verbs share, what they mean, and how a result is shown."""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from ..errors import ResourceError, UsageError

Allow = Annotated[
    list[str] | None,
    typer.Option("--allow-plugin", help="Run this plugin's code: an installed plugin's name, a file or a folder."),
]
Config = Annotated[
    Path | None,
    typer.Option(
        "--config", "-c", help="YAML over the preset, or a shipped one by name (networks/paper); key=value goes on top."
    ),
]
Overrides = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="KEY=VALUE",
        help="Over the config: frames=12 losses.framing=null; a component's: `cltransfer plugins show NAME`.",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="The result as JSON on stdout, nothing else there.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress on stderr.")]
Up = Annotated[
    str | None,
    typer.Option(
        help="The scene's up as X,Y,Z; by default 0,-1,0 of splats and grids, 0,1,0 of meshes, 0,0,1 where a "
        "splat's header says that z is vertical."
    ),
]
Out = Annotated[Path | None, typer.Option("--out", "-o", help="Folder for the results; by default one in outputs/.")]


def fail(reason: object, code: int) -> NoReturn:
    """End with one line on stderr, if anybody reads it, and this exit code."""
    line = " ".join(str(reason).split())
    with contextlib.suppress(OSError):
        print(f"error: {printable(line)}", file=sys.stderr)
    sys.exit(code)


class Terminated(BaseException):
    """SIGTERM; no ``except Exception`` on the way may keep it."""


STOPS = (KeyboardInterrupt, Terminated)


def stopped(stop: BaseException, way_on: str = "") -> NoReturn:
    """End with the line and the exit code of one of :data:`STOPS`, and how the work goes on from there."""
    word, code = ("terminated", 143) if isinstance(stop, Terminated) else ("interrupted", 130)
    fail(word + f" ({way_on})" * bool(way_on), code)


@contextlib.contextmanager
def goes_on(way_on: Callable[[], str]) -> Iterator[None]:
    """Whatever stops the work within from outside, a signal or a full disk, is told with how it goes on from there.

    Args:
        way_on: asked when it was stopped; empty where nothing was begun.

    Raises:
        ResourceError: a file cannot be written or read.
    """
    try:
        yield
    except STOPS as stop:
        stopped(stop, way_on())
    except BrokenPipeError:
        raise
    except OSError as error:
        if not (way := way_on()):
            raise
        raise ResourceError(error.filename or "", "", str(error.strerror or error), way) from error
    except ResourceError as error:  # which the system may have said; what has a hint is told as it is
        if error.hint or not isinstance(error.__context__, OSError) or not (way := way_on()):
            raise
        raise ResourceError(error.where, error.field, error.reason, way) from error


def show(values: Any, text: str, as_json: bool) -> None:
    """Print ``values`` as JSON, or ``text``."""
    print(json.dumps(values, indent=2, allow_nan=False) if as_json else printable(text))


def tell(notes: list[str], as_json: bool) -> None:
    """Print ``notes`` beside a result; JSON stands alone."""
    for note in notes * (not as_json):
        print(f"note: {printable(note)}")


def printable(text: str) -> str:
    r"""``text`` without signs that a terminal would act on, which somebody's file may hold; line ends stay.

    >>> print(printable("a \x1b[31mred\x1b[0m\nname"))
    a \x1b[31mred\x1b[0m
    name
    """
    return "".join(sign if sign.isprintable() or sign == "\n" else ascii(sign)[1:-1] for sign in text)


def unused_plugins(names: list[str] | None, *settings: Any) -> list[str]:
    """Notes on allowed plugins of whose components none of ``settings`` names one."""
    from ..config.options import SECTIONS
    from ..plugins import installed, settle
    from ..registry import FITTERS

    modules, notes = {plugin.name: plugin.module.partition(":")[0] for plugin in installed()}, []
    for name, settled in zip(names or [], settle(names or [])):
        by = modules.get(settled, settled)
        given = [(section, part) for section, all_ in SECTIONS.items() for part in all_.given_by(by)]
        if any(hasattr(SECTIONS[section].get(part), "suffixes") for section, part in given):
            continue  # it may have read the scene of a reference
        if given and not any(part in getattr(config, section) for section, part in given for config in settings):
            known = ", ".join(f"{section}.{part}={{}}" for section, part in given)
            notes.append(f"plugin {name} is allowed, but none of its components is in use ({known})")
        if not given and not FITTERS.given_by(by):
            notes.append(f"plugin {name} is allowed, but registers nothing: @LOSSES.register(...) above a class does")
    return notes


def settings_of(config: Path | None, overrides: list[str], plugins: list[str] | None) -> Any:
    """The config of a command, its plugins let in before."""
    from ..config import load_config
    from ..plugins import allow

    allow(plugins or [])
    return load_config(config, overrides)


def check_keys(overrides: Iterable[str], known: Sequence[str], what: str, hint: str = "") -> None:
    """Refuse overrides of keys that are not ``known`` to change anything of ``what``; a config may have any.

    Raises:
        UsageError: there is one.
    """
    for override in overrides:
        key = override.partition("=")[0].partition(".")[0]
        if key not in known:
            reason = f"changes nothing of {what}, expected a key that it looks at"
            raise UsageError("", key, reason, f"{', '.join(known)}{hint}")


def up_of(text: str | None) -> tuple[float, float, float] | None:
    """What ``--up`` says.

    Raises:
        UsageError: it is no vector.
    """
    if text is None:
        return None
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise UsageError("", "--up", f"expected X,Y,Z, got {text!r}") from None
    return x, y, z
