"""What a slip on the command line was meant as: a key for an option, an option for a key, a clip for the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from ..errors import UsageError


def told(error: Any, arguments: Sequence[str]) -> str:
    """What ``error``, of the parser, says, and how the command that it is about is written."""
    command, line = getattr(getattr(error, "ctx", None), "command", None), str(error.format_message())
    if command is None or not line.startswith("Missing argument"):
        return meant_as_key(error, arguments)
    needed = " ".join(
        one.metavar or str(one.name).upper()
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
    from ..clips.image_folder import VIDEOS
    from ..scenes.load import MESH_SUFFIXES

    first, second = (Path(name.partition("#")[0]) for name in (scene, reference))
    folder = second.suffix.lower() in (".ply", ".splat", ".spz", *MESH_SUFFIXES) and first.is_dir()
    if first.suffix.lower() in VIDEOS or folder:
        hint = "the scene comes first: cltransfer transfer SCENE CLIP"
        raise UsageError(scene, "", f"is {'a folder' if folder else 'a video'}, expected a scene", hint)
