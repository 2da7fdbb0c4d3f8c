"""The verbs of ``cltransfer cache``: what is kept so that it is not done again, and how it is thrown away."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

import typer

from .shared import Json, show

app = typer.Typer(
    help="What was read, found and pulled before: how much there is, throwing it away.", no_args_is_help=True
)


@app.command("list")
def cache_list(as_json: Json = False) -> None:
    """How much of each kind the cache holds, and where it is. Nothing is ever thrown away by itself."""
    from ..storage.cache import held
    from ..storage.files import cache_dir

    rows = held()
    lines = [f"{row.kind:<10}{row.files:>7} files{row.size / 2**20:>10.1f} MB  {row.what}" for row in rows]
    values = {"folder": str(cache_dir()), "kinds": [asdict(row) for row in rows]}
    show(values, "\n".join([str(cache_dir()), *lines]), as_json)


@app.command("clear")
def cache_clear(
    kinds: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="KIND", help="Of those that `cltransfer cache list` names; scenes, models, assets only so."
        ),
    ] = None,
) -> None:
    """Throw away what was read and found before; it is made again when it is needed.

    cltransfer cache clear features
    """
    from ..storage.cache import clear

    gone = clear(kinds or ())
    print(f"{sum(row.files for row in gone)} files, {sum(row.size for row in gone) / 2**20:.1f} MB thrown away")
