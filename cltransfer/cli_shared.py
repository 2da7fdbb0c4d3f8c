"""Options that several verbs share, and how a result is shown."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

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
        metavar="[KEY=VALUE]...",
        help="Over the config: frames=12 losses.framing=null; a component's: `cltransfer plugins show NAME`.",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="The result as JSON on stdout, nothing else there.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress on stderr.")]


def show(values: Any, text: str, as_json: bool) -> None:
    """Print ``values`` as JSON, or ``text``."""
    print(json.dumps(values, indent=2, allow_nan=False) if as_json else text)
