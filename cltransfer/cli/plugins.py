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
    name: Annotated[str, typer.Argument(help="Component, e.g. shot_size.")],
    allow_plugin: Allow = None,
    as_json: Json = False,
) -> None:
    """What a component does, requires and provides, and its options with their defaults."""
    from ..config.options import SECTIONS
    from ..plugins import allow

    allow(allow_plugin or [])
    found = [(section, registry) for section, registry in SECTIONS.items() if name in registry.names()]
    if not found:
        known = [n for registry in SECTIONS.values() for n in registry.names()]
        from ..typed import nearest

        raise UsageError("", name, "no such component", nearest(name, known))
    section, registry = found[0]
    cls = registry.get(name)
    options = {key: repr(value) for key, value in registry.options(name).items()}
    values: dict[str, Any] = {
        "section": section,
        "about": (cls.__doc__ or "").strip(),
        "requires": sorted(getattr(cls, "requires", ())),
        "provides": sorted(getattr(cls, "provides", ())),
        "options": options,
        "reads": sorted(getattr(cls, "suffixes", ())),
    }
    lines = [f"{section}.{name}", values["about"], f"requires: {', '.join(values['requires']) or 'nothing'}"]
    lines += [f"provides: {', '.join(values['provides'])}"] if values["provides"] else []
    lines += [f"reads: {', '.join(values['reads'])}"] if values["reads"] else []
    lines += [f"  {key} = {value}" for key, value in options.items()]
    show(values, "\n".join(lines), as_json)
