"""Plugins: other people's components. Their code runs only when the user, not a config, has allowed it.

An installed plugin announces itself under the entry-point group ``cltransfer.plugins``; its name is the component's.
A plugin in a file or folder is named by its path. Listing never imports.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from .errors import ModelError

GROUP = "cltransfer.plugins"
NO_PLUGINS = ("_", "test_", "conftest.")  # how files begin that may lie beside plugins in their folder


@dataclass(frozen=True)
class Plugin:
    """An installed plugin as its package describes it; nothing of it has been imported."""

    name: str
    module: str
    distribution: str
    version: str


def installed() -> list[Plugin]:
    """Every installed plugin, by name."""
    found = []
    for point in entry_points(group=GROUP):
        dist = point.dist
        found.append(Plugin(point.name, point.value, dist.name if dist else "?", dist.version if dist else "?"))
    return sorted(found, key=lambda p: p.name)


def allow(names: Iterable[str | Path]) -> list[str]:
    """Import the named plugins so that their decorators register them; returns what was imported.

    Args:
        names: an installed plugin's name, a Python file, or a folder whose Python files are plugins, but for tests.

    Raises:
        ModelError: there is no such plugin, or its code fails.
    """
    return import_settled(settle(names))


def settle(names: Iterable[str | Path]) -> list[str]:
    """What ``names`` mean, for any process: an installed plugin's name, or else the whole path of a file or folder.

    An installed plugin comes before a file or a folder of its name.

    Raises:
        ModelError: there is no such plugin.
    """
    points, settled = {point.name for point in entry_points(group=GROUP)}, []
    for name in map(str, names):
        path = Path(name).absolute()
        if name not in points and not path.is_dir() and not (path.is_file() and path.suffix == ".py"):
            known = ", ".join(sorted(points)) or "none installed"
            raise ModelError(name, "--allow-plugin", "no such plugin, file or folder", f"installed: {known}")
        settled.append(name if name in points else str(path))
    return settled


def import_settled(names: Sequence[str]) -> list[str]:
    """Import what :func:`settle` has told, here or in another process; returns what was imported.

    Raises:
        ModelError: it is not here, or its code fails.
    """
    if names and os.environ.get("CLTRANSFER_DISABLE_PLUGINS") == "1":
        raise ModelError("", "--allow-plugin", "plugins are switched off", "unset CLTRANSFER_DISABLE_PLUGINS")
    points = {point.name: point for point in entry_points(group=GROUP)}
    by_name = [name for name in names if not Path(name).is_absolute()]
    for name in by_name:
        if name not in points:
            raise ModelError(name, "--allow-plugin", "expected an installed plugin, it is not", "install it here too")
        _import_point(points[name])
    files = [file for name in names if name not in by_name for file in _files(Path(name))]
    return by_name + [_import_file(path) for path in {path.resolve(): path for path in files}.values()]


def _files(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    members = sorted(p for p in path.glob("*.py") if not p.name.startswith(NO_PLUGINS))
    if not members:
        raise ModelError(path, "--allow-plugin", "no Python file in this folder")
    return members


def _import_point(point: EntryPoint) -> None:
    try:
        point.load()
    except ModelError:
        raise
    except (Exception, SystemExit) as error:
        raise ModelError(point.value, "plugin", f"failed at import: {type(error).__name__}: {error}") from error


def _import_file(path: Path) -> str:
    place = hashlib.sha256(os.fsencode(path.resolve())).hexdigest()[:8]  # another file may have the same name
    name = f"cltransfer_plugin_{path.stem}_{place}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up
    try:
        spec.loader.exec_module(module)
    except ModelError:
        del sys.modules[name]
        raise
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise ModelError(path, "plugin", f"failed at import: {type(error).__name__}: {error}") from error
    return str(path)
