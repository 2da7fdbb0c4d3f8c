"""Plugins: other people's components. Their code runs only when the user, not a config, has allowed it.

An installed plugin announces itself under the entry-point group ``cltransfer.plugins``; its name is the component's.
A plugin in a file or folder is named by its path. Listing never imports.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import sys
from collections.abc import Iterable
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
    asked = [str(name) for name in names]
    if asked and os.environ.get("CLTRANSFER_DISABLE_PLUGINS") == "1":
        raise ModelError("", "--allow-plugin", "plugins are switched off", "unset CLTRANSFER_DISABLE_PLUGINS")
    points = {point.name: point for point in entry_points(group=GROUP)}
    imported: list[str] = []
    files: list[Path] = []
    for name in asked:
        path = Path(name)
        if name in points:
            _import_point(points[name])
            imported.append(name)
        elif path.is_dir():
            members = sorted(p for p in path.glob("*.py") if not p.name.startswith(NO_PLUGINS))
            if not members:
                raise ModelError(path, "--allow-plugin", "no Python file in this folder")
            files += members
        elif path.is_file() and path.suffix == ".py":
            files.append(path)
        else:
            known = ", ".join(sorted(points)) or "none installed"
            raise ModelError(name, "--allow-plugin", "no such plugin, file or folder", f"installed: {known}")
    return imported + [_import_file(path) for path in {path.resolve(): path for path in files}.values()]


def _import_point(point: EntryPoint) -> None:
    try:
        point.load()
    except ModelError:
        raise
    except (Exception, SystemExit) as error:
        raise ModelError(point.value, "plugin", f"failed at import: {type(error).__name__}: {error}") from error


def _import_file(path: Path) -> str:
    place = hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:8]  # another file may have the same name
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
