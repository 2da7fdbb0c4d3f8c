"""The verbs of ``cltransfer plugins``: what components there are, and their options."""

from __future__ import annotations

from inspect import cleandoc
from typing import Annotated, Any

import typer

from ..errors import UsageError
from .shared import Allow, Json, show

app = typer.Typer(help="Components: what there is, and their options.", no_args_is_help=True)

CONFIG = "config"  # what `plugins show` calls the keys of a run itself
FIT = "fit"


@app.command("list")
def plugins_list(allow_plugin: Allow = None, as_json: Json = False) -> None:
    """Every component by kind, those of allowed plugins too, and installed plugins (listed, not imported)."""
    from ..plugins import allow, installed

    allow(allow_plugin or [])
    values: dict[str, Any] = {section: registry.names() for section, registry in _sections().items()}
    values["installed plugins"] = [f"{p.name} ({p.distribution} {p.version})" for p in installed()]
    show(values, "\n".join(f"{kind}: {', '.join(names) or 'none'}" for kind, names in values.items()), as_json)


@app.command("show")
def plugins_show(
    name: Annotated[
        str, typer.Argument(help="Component, e.g. shot_size or losses.shot_size or fit.nerf_grid; or config.")
    ],
    allow_plugin: Allow = None,
    as_json: Json = False,
) -> None:
    """What a component does, requires and provides, and its options with their defaults; or the keys of a config.

    cltransfer plugins show shot_size

    cltransfer plugins show config
    """
    from ..plugins import allow
    from ..registry.declared import names_of

    allow(allow_plugin or [])
    if name == CONFIG:
        _show_config(as_json)
        return
    section, _, own = _key(name).partition(".")
    registry = _sections()[section]
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


def _show_config(as_json: bool) -> None:
    """What the keys of a run mean, and what the default preset sets them to."""
    from dataclasses import asdict

    from ..config import load_config
    from ..config.adam import AdamConfig
    from ..config.options import SECTIONS, ExtractConfig, RunConfig

    values = {key: value for key, value in asdict(load_config()).items() if key not in SECTIONS}
    about = {"": RunConfig, "adam.": AdamConfig, "extract.": ExtractConfig}
    texts = {prefix: cleandoc(cls.__doc__ or "") for prefix, cls in about.items()}
    lines = [line for prefix, text in texts.items() for line in (f"{prefix.rstrip('.') or 'config'}: {text}", "")]
    flat = {key: value for key, value in values.items() if not isinstance(value, dict)}
    flat |= {f"{key}.{own}": v for key, value in values.items() if isinstance(value, dict) for own, v in value.items()}
    lines += ["by preset=balanced, which is the default (`transfer --print-config preset=fast` has another's):"]
    lines += [f"  {key} = {value!r}" for key, value in flat.items()]
    show({"about": texts, "options": flat}, "\n".join(lines), as_json)


def _sections() -> dict[str, Any]:
    """What there is by kind: sections of a config, and what `fit` takes."""
    from ..config.options import SECTIONS
    from ..registry import FITTERS

    return {**SECTIONS, FIT: FITTERS}


def _key(name: str) -> str:
    """The component that is named ``shot_size`` or ``losses.shot_size``, as a config has it; a fitter by both words.

    Raises:
        UsageError: there is none, or several of one name.
    """
    from ..registry.typed import nearest

    keys = {f"{section}.{n}": n for section, registry in _sections().items() for n in registry.names()}
    found = [key for key, n in keys.items() if name == key or (name == n and not key.startswith(f"{FIT}."))]
    if not found:
        raise UsageError("", name, "no such component", nearest(name, set(keys) if "." in name else set(keys.values())))
    if len(found) > 1:
        raise UsageError("", name, f"{len(found)} components have this name", f"show one: {', '.join(found)}")
    return found[0]
