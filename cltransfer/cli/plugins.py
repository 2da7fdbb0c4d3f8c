"""The verbs of ``cltransfer plugins``: what components there are, and their options."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from ..errors import UsageError
from .shared import Allow, Json, show

app = typer.Typer(help="Components: what there is, and their options.", no_args_is_help=True)


@app.command("list")
def plugins_list(allow_plugin: Allow = None, as_json: Json = False) -> None:
    """Every component by kind, those of allowed plugins too, and installed plugins (listed, not imported)."""
    from ..config.options import SECTIONS
    from ..plugins import allow, installed

    allow(allow_plugin or [])
    values: dict[str, Any] = {section: registry.names() for section, registry in SECTIONS.items()}
    values["installed plugins"] = [f"{p.name} ({p.distribution} {p.version})" for p in installed()]
    show(values, "\n".join(f"{kind}: {', '.join(names) or 'none'}" for kind, names in values.items()), as_json)


@app.command("show")
def pluginsshow(
    name: Annotated[str, typer.Argument(help="Component, e.g. shot_size or losses.shot_size.")],
    allow_plugin: Allow = None,
    as_json: Json = False,
) -> None:
    """What a component does, requires and provides, and its options with their defaults."""
    from ..config.options import SECTIONS
    from ..plugins import allow
    from ..registry.declared import names_of

    allow(allow_plugin or [])
    section, _, own = _key(name).partition(".")
    registry = SECTIONS[section]
    cls = registry.get(own)
    options = {option: repr(value) for option, value in registry.options(own).items()}
    values: dict[str, Any] = {
        "section": section,
        "about": (cls.__doc__ or "").strip(),
        "requires": names_of(cls, "requires"),
        "provides": names_of(cls, "provides"),
        "options": options,
        "reads": sorted(getattr(cls, "suffixes", ())),
        "draws": names_of(cls, "draws"),
    }
    lines = [f"{section}.{own}", values["about"], f"requires: {', '.join(values['requires']) or 'nothing'}"]
    lines += [f"{what}: {', '.join(values[what])}" for what in ("provides", "reads", "draws") if values[what]]
    lines += [f"  {option} = {value}" for option, value in options.items()]
    show(values, "\n".join(lines), as_json)


def _key(name: str) -> str:
    """The component that is named ``shot_size`` or ``losses.shot_size``, as a config has it.

    Raises:
        UsageError: there is none, or several of one name.
    """
    from ..config.options import SECTIONS
    from ..registry.typed import nearest

    keys = {f"{section}.{n}": n for section, registry in SECTIONS.items() for n in registry.names()}
    found = [key for key, n in keys.items() if name in (key, n)]
    if not found:
        raise UsageError("", name, "no such component", nearest(name, [*keys, *keys.values()]))
    if len(found) > 1:
        raise UsageError("", name, f"{len(found)} components have this name", f"show one: {', '.join(found)}")
    return found[0]
