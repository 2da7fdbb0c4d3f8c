"""Config: one YAML grammar, one parent by ``base``, ``key=value`` on top; checked before anything heavy loads.

``section: {name: {options}}`` names a component of a registry; ``null`` removes what the parent had. A config names
components, it never loads code: see :mod:`cltransfer.plugins`.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files as package_files
from pathlib import Path
from typing import Any

from ..errors import UsageError
from ..registry import LOSSES
from ..registry.typed import nearest, typed
from .layers import COMMAND_LINE, ONE_EACH, Layer, origin, parse_overrides, read_yaml, told
from .options import SECTIONS, RunConfig


def to_yaml(config: RunConfig) -> str:
    """The merged config, complete and re-runnable.

    What the preset has and ``config`` has not is null, and an option that the preset alone sets has its default.
    """
    from omegaconf import OmegaConf

    raw, below = dataclasses.asdict(config), _read(shipped_configs() / f"{config.preset}.yaml").values
    for section, registry in SECTIONS.items():
        for name, options in (below.get(section) or {}).items():
            if unset := (options or {}).keys() - raw[section].get(name, options or {}).keys():
                defaults = registry.options(name)
                raw[section][name] |= {option: defaults[option] for option in sorted(unset)}
            elif section not in ONE_EACH:
                raw[section].setdefault(name, None)
    return OmegaConf.to_yaml(OmegaConf.create(raw))


def presets() -> list[str]:
    """Names of the shipped configs."""
    return sorted(p.name[: -len(".yaml")] for p in shipped_configs().iterdir() if p.name.endswith(".yaml"))


def load_config(path: str | Path | None = None, overrides: Iterable[str] = (), *, whole: bool = False) -> RunConfig:
    """Config of a file (or of the preset alone) with ``key=value`` overrides on top.

    A shipped file may be named without its folder and suffix, as ``networks/paper``.
    ``preset=NAME`` among the overrides, or ``preset:`` in the file, chooses what lies below (default: balanced).
    ``whole`` expects a file that stands by itself, as a run keeps one: somebody else's does not say what else is read.

    Raises:
        UsageError: a file is missing, too large or no YAML; an unknown key, component or option (the nearest is
            named), a value of the wrong type or range; another preset than that of a file which sets every key.
    """
    above = layer_of(parse_overrides(overrides), COMMAND_LINE)
    if "base" in above.values:
        raise UsageError(
            COMMAND_LINE, "base", "expected in a file, which it lies below", "use --config FILE or preset=NAME"
        )
    if not path:
        return lay_config([above])
    file = _read_chain(_named(Path(path)), whole)
    _refuse_other_preset(above, file)
    return lay_config([file, above])


def layer_of(values: Mapping[str, Any], where: str | Path) -> Layer:
    """The layer of ``values`` that are written in ``where``, their names checked.

    Raises:
        UsageError: an unknown key, component or option; the nearest is named.
    """
    _check(values, where)
    return Layer.written(values, where)


def lay_config(layers: Sequence[Layer]) -> RunConfig:
    """Config of ``layers``, the last on top, over the preset that the highest of them names (default: balanced).

    Raises:
        UsageError: as :func:`load_config`, in the name of the layer that is to blame.
    """
    preset, where = next(
        ((layer.values["preset"], layer.origins["preset"]) for layer in reversed(layers) if "preset" in layer.values),
        ("balanced", ""),
    )
    if preset not in presets():
        raise UsageError(where, "preset", f"no preset {preset!r}", nearest(str(preset), presets()))
    merged = _read(shipped_configs() / f"{preset}.yaml")
    for layer in layers:
        merged = layer.over(merged)
    config = _typed({**merged.values, "preset": preset}, merged.origins)
    config.origins = merged.origins
    return config


def shipped_configs() -> Any:
    """The folder of the shipped configs, in a checkout as when installed."""
    installed = package_files("cltransfer") / "configs"
    return installed if installed.is_dir() else Path(__file__).resolve().parents[2] / "configs"


def _named(path: Path) -> Path:
    """The file, or where there is none a shipped one by its name alone, as ``networks/paper``.

    Raises:
        UsageError: there is neither; the nearest shipped one is named.
    """
    if path.exists():
        return path
    shipped = Path(str(shipped_configs()))
    named = [*presets(), *(f"networks/{found.stem}" for found in sorted((shipped / "networks").glob("*.yaml")))]
    if str(path) not in named:
        raise UsageError(path, "", "no such file", nearest(str(path.with_suffix("")), named))
    return shipped / f"{path}.yaml"


def _read_chain(path: Path, whole: bool) -> Layer:
    """A file over its ``base``; the base is named beside it and may name no other. A ``whole`` one has none."""
    own = _read(path)
    base = own.values.get("base")
    if base is None:
        return own
    if whole:
        raise UsageError(path, "base", "expected a whole config, got one over another", "merge the two files")
    parent_path = _base(path, base)
    parent = _read(parent_path)
    if "base" in parent.values:
        raise UsageError(parent_path, "base", "a base names no further base", "merge the two files")
    _refuse_other_preset(own, parent)
    return own.over(parent)


def _refuse_other_preset(above: Layer, below: Layer) -> None:
    """Of another preset nothing but its name would be left below a file that sets every key, as a run keeps one."""
    if not {field.name for field in dataclasses.fields(RunConfig)} <= below.values.keys():
        return
    own, asked = below.values["preset"], above.values.get("preset", below.values["preset"])
    if asked != own:
        reason = f"expected {own}, of which {below.origins['preset']} sets every key, got {asked}"
        raise UsageError(above.origins["preset"], "preset", reason, "leave that file out, or set the keys")


def _base(path: Path, base: Any) -> Path:
    """The file that ``path`` names as its ``base``, beside it or in the folder above.

    Raises:
        UsageError: it is no text, there is no such file, or it lies elsewhere.
    """
    if not isinstance(base, str) or not base or "\0" in base:
        raise UsageError(path, "base", "expected the name of a file", f"got {base!r}")
    if base.replace("\\", "/").startswith("//"):  # Windows would ask another computer for it
        raise UsageError(path, "base", "expected a file in this folder or the one above", f"got {base}")
    found = path.parent / base
    if not Path(os.path.realpath(found)).is_relative_to(path.parent.resolve().parent):
        raise UsageError(path, "base", "expected a file in this folder or the one above", f"got {base}")
    if not found.is_file():
        reason = "expected a file, got a folder" if found.is_dir() else "no such file"
        raise UsageError(path, "base", f"{base}: {reason}", "name one in this folder or the one above")
    return found


def _read(path: Any) -> Layer:
    return layer_of(read_yaml(path), path)


def _check(raw: Mapping[str, Any], where: Any) -> None:
    """Names at both levels, without importing a component."""
    known = [f.name for f in dataclasses.fields(RunConfig)]
    for key, value in raw.items():
        if key not in known and key != "base":
            first, *below = str(key).split(".")
            hint = f"write {_nested([first, *below])}" if below and first in known else nearest(str(key), known)
            raise UsageError(where, str(key), "no such key", hint)
        if key in SECTIONS:
            _check_section(key, value, where)


def _nested(keys: Sequence[str]) -> str:
    """Keys that a dot was between, as YAML has them.

    >>> _nested(["losses", "framing", "weight"])
    'losses: {framing: {weight: ...}}'
    """
    first, *below = keys
    return f"{first}: " + (f"{{{_nested(below)}}}" if below else "...")


def _check_section(section: str, value: Any, where: Any) -> None:
    if value is None:
        return
    if not isinstance(value, Mapping):
        raise UsageError(where, section, "expected name: {options}", f"got {value!r}")
    registry = SECTIONS[section]
    for name, options in value.items():
        if str(name) not in registry.names():
            let_in = "a plugin needs --allow-plugin, in Python cltransfer.plugins.allow, and has to register it"
            hint = f"{nearest(name, registry.names())}; {let_in}"
            raise UsageError(where, f"{section}.{name}", f"no such {registry.kind}", hint)
        if options is None:
            continue
        if not isinstance(options, Mapping):
            raise UsageError(where, f"{section}.{name}", "expected options as a mapping", "write {} for the defaults")
        declared = registry.declared_options(str(name))
        for option in options:
            if option not in declared:
                raise UsageError(where, f"{section}.{name}.{option}", "no such option", nearest(option, declared))


def _typed(merged: Mapping[str, Any], origins: Mapping[str, str]) -> RunConfig:
    clean = {k: v for k, v in merged.items() if k != "base"}
    for section in SECTIONS:
        named = {n: o for n, o in (clean.get(section) or {}).items() if o is not None}
        if section in ONE_EACH and len(named) != 1:
            where = origin(origins, section)
            raise UsageError(where, section, f"expected exactly one, got {len(named)}", ", ".join(named))
        clean[section] = named
    if not clean["losses"]:
        where = origin(origins, "losses")
        raise UsageError(where, "losses", "expected at least one", f"known: {', '.join(LOSSES.names())}")
    try:
        return typed(RunConfig, clean)
    except UsageError as error:
        raise told(error, origins) from None
