"""Slips on the command line: a key for an option, an option for a key, a clip for the scene, what is said twice."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import typer

from ..errors import UsageError

KEY = re.compile(r"[-. ]*\w[-\w. ]*=")  # no name with a /, : or # is one


def command_of(command: Any, words: Sequence[str]) -> tuple[Any, Sequence[str]]:
    """The command that ``words`` name, ``command`` or one below it, and the words behind its name."""
    while words and words[0] in getattr(command, "commands", {}):
        command, words = command.commands[words[0]], words[1:]
    return command, words


def check_once(command: Any, words: Sequence[str]) -> None:
    """Refuse what is said twice behind the name of a ``command`` of the parser, which takes the last.

    Raises:
        UsageError: an option, or a key, has a value that a later one replaces.
    """
    context = typer.Context(command, resilient_parsing=True)  # what else is wrong is told later
    values, _, given = command.make_parser(context).parse_args(list(words))
    if any(one.is_eager for one in given):  # --help
        return
    for i, one in enumerate(given):
        if one in given[:i] and not one.multiple and (not one.is_flag or one.secondary_opts):
            raise UsageError("", one.opts[0], "expected once, it is there twice", "leave one out")
    if keys := [one for one in given if "KEY=VALUE" in str(one.metavar)]:  # they stand where a path is left out too
        _check_keys([word for one in given if one in keys or not one.required for word in _words(one, values)])


def _words(parameter: Any, values: Mapping[str, Any]) -> Sequence[str]:
    """What stands on the command line for a ``parameter`` without a name there, of the parser's ``values``."""
    if parameter.param_type_name != "argument":
        return ()
    value = values[parameter.name]
    return [value] if isinstance(value, str) else value if isinstance(value, tuple | list) else ()


def _check_keys(arguments: Sequence[str]) -> None:
    """Refuse an override that a later one replaces; what they say of several parts of one mapping is merged."""
    from ..config.layers import COMMAND_LINE, parse_overrides

    said: dict[str, str] = {}  # overrides, by what they set
    for item in filter(is_override, arguments):
        try:
            parts = dict(_parts(parse_overrides([item])))
        except UsageError:  # told where it is read
            continue
        for key, value in parts.items():
            lost = [other for other in said if other == key or (value is None and other.startswith(f"{key}."))]
            if lost:
                came = f"expected once, got {said[lost[0]]} before {item}"
                raise UsageError(COMMAND_LINE, lost[0], came, "leave one out")
        said.update(dict.fromkeys(parts, item))


def _parts(values: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """What nested ``values`` set, by ``section.name.option``."""
    for key, value in values.items():
        if isinstance(value, Mapping) and value:
            yield from _parts(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value


def is_override(argument: str) -> bool:
    """Whether it is key=value, its key perhaps misspelt with dashes or spaces, and not a file whose name has a =."""
    return KEY.match(argument) is not None and not os.path.exists(argument)


def told(error: Any, arguments: Sequence[str]) -> str:
    """What ``error``, of the parser, says, and how the command that it is about is written."""
    command, line = getattr(getattr(error, "ctx", None), "command", None), str(error.format_message())
    if command is None or not line.startswith("Missing argument"):
        return meant_as_key(error, arguments)
    needed = " ".join(
        (one.metavar or str(one.name).upper()) + "..." * (one.nargs != 1)
        for one in command.params
        if one.required and not one.opts[0].startswith("-")
    )
    own = str(error.ctx.find_root().info_name)  # of several words where it runs as `python -m cltransfer`
    path = f"cltransfer{str(error.ctx.command_path).removeprefix(own)}"
    return f"{line.rstrip('.')} (expected: {path} {needed}; {path} --help tells more)"


def meant_as_key(error: Any, arguments: Sequence[str]) -> str:
    """What ``error``, of the parser, says; where it is about an option by the name of a key, how that is written."""
    from ..config.options import RunConfig

    name, command = getattr(error, "option_name", ""), getattr(getattr(error, "ctx", None), "command", None)
    key = name.lstrip("-").replace("-", "_")
    if key.partition(".")[0] not in {field.name for field in fields(RunConfig)} or "config" not in options_of(command):
        return str(error.format_message())
    value = ""
    for argument, following in zip(arguments, [*arguments[1:], ""]):
        if argument.partition("=")[0] == name:
            value = argument.partition("=")[2] or following
    value = "VALUE" if value.startswith("-") else value or "VALUE"
    return f"No such option: {name} (keys are set without dashes: {key}={value})"


def options_of(command: Any) -> list[str]:
    """Options of a command of the parser, without dashes; none of None."""
    return [name.lstrip("-") for option in getattr(command, "params", ()) for name in option.opts]


def meant_as_option(error: UsageError, options: Sequence[str], arguments: Sequence[str]) -> UsageError:
    """``error``, and where it is about a key by the name of one of the command's ``options``, how that is written."""
    if error.reason != "no such key" or error.field.replace("_", "-") not in options:
        return error
    name = error.field.replace("_", "-")
    values = [value for key, _, value in (argument.partition("=") for argument in arguments) if key == error.field]
    return UsageError(error.where, error.field, error.reason, f"{' '.join([f'--{name}', *values[:1]])} is an option")


def check_order(scene: str, reference: str) -> None:
    """Refuse a clip where the scene is named.

    Raises:
        UsageError: ``scene`` is a video, or a folder where ``reference`` is a scene.
    """
    from ..clips.decoding import VIDEOS
    from ..scenes.load import MESH_SUFFIXES

    first, second = (Path(name.partition("#")[0]) for name in (scene, reference))
    folder = second.suffix.lower() in (".ply", ".splat", ".spz", *MESH_SUFFIXES) and first.is_dir()
    if first.suffix.lower() in VIDEOS or folder:
        hint = "the scene comes first: cltransfer transfer SCENE CLIP"
        raise UsageError(scene, "", f"is {'a folder' if folder else 'a video'}, expected a scene", hint)
