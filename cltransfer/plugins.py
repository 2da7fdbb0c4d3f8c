"""Plugins: other people's components. Their code runs only when the user, not a config, has allowed it.

An installed plugin announces itself under the entry-point group ``cltransfer.plugins``, by a name of its own.
A plugin in a file or folder is named by its path. Listing never imports.
"""

from __future__ import annotations

import hashlib
import importlib.util
import logging
import os
import shlex
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from traceback import walk_tb

from .errors import ModelError
from .registry import EXTRACTORS, FITTERS, LOSSES, RENDERERS, SEARCHES
from .registry.plugin_code import code_in, edited

GROUP = "cltransfer.plugins"
REGISTRIES = (LOSSES, EXTRACTORS, RENDERERS, SEARCHES, FITTERS)
NO_PLUGINS = ("_", "test_", "conftest.")  # how files begin that may lie beside plugins in their folder

_log = logging.getLogger("cltransfer")
_CODE: dict[str, str] = {}  # digest of what was imported, by module
_SILENT: set[str] = set()  # modules that registered nothing, as what only helps a plugin does not


@dataclass(frozen=True)
class Source:
    """A file of Python to be imported.

    Args:
        path: of the file.
        module: its name as a module.
        package: name of the package that is imported with it, empty where it stands alone.
    """

    path: Path
    module: str
    package: str = ""

    def code(self) -> str:
        """Digest of all that it may import by being named."""
        return code_in(self.path.parent) if self.package else hashlib.sha256(self.path.read_bytes()).hexdigest()


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


def allow(names: str | Path | Iterable[str | Path]) -> list[str]:
    """Import the named plugins so that their decorators register them; returns what was imported.

    Args:
        names: an installed plugin's name, a Python file, or a folder whose Python files are plugins, but for tests.
            A folder with an ``__init__.py`` is imported as a package. No code runs that lies elsewhere than is named,
            and none a second time that has not changed. An installed plugin is imported once in a process: its package
            may be what runs there. That it was edited since is warned of.

    Raises:
        ModelError: there is no such plugin, several packages announce it, or its code fails.
    """
    return import_settled(settle(names))


def settle(names: str | Path | Iterable[str | Path]) -> list[str]:
    """What ``names`` mean, for any process: an installed plugin's name, or else the whole path of a file or folder.

    An installed plugin comes before a file or a folder of its name.

    Raises:
        ModelError: there is no such plugin, or a name is empty, which as a path would be the current folder.
    """
    points, settled = {point.name for point in entry_points(group=GROUP)}, []
    for name in map(str, [names] if isinstance(names, (str, Path)) else names):
        if not name.strip():
            raise ModelError("", "--allow-plugin", "expected a plugin's name, a file or a folder, got nothing")
        path = Path(name).absolute()
        if name not in points and not path.is_dir() and not (path.is_file() and path.suffix == ".py"):
            known = ", ".join(sorted(points)) or "none installed"
            raise ModelError(name, "--allow-plugin", "no such plugin, file or folder", f"installed: {known}")
        settled.append(name if name in points else str(path))
    return settled


def import_settled(names: Sequence[str]) -> list[str]:
    """Import what :func:`settle` has told, here or in another process; returns what was imported.

    Raises:
        ModelError: it is not here, several packages announce it, or its code fails.
    """
    if names and os.environ.get("CLTRANSFER_DISABLE_PLUGINS", "") not in ("", "0"):
        raise ModelError("", "--allow-plugin", "plugins are switched off", "unset CLTRANSFER_DISABLE_PLUGINS")
    by_name = [name for name in names if not Path(name).is_absolute()]
    for point in [_point(name) for name in by_name]:
        _import_point(point)
    found = [source for name in names if name not in by_name for source in _sources(Path(name))]
    found.sort(key=lambda source: not source.package)  # of a file that is named twice what knows its package
    files: dict[Path, Source] = {}
    for source in found:
        files.setdefault(source.path.resolve(), source)
    imported = [_import_file(source) for source in files.values()]
    _SILENT.update(source.module for source in files.values() if not _registers(source.module))
    return by_name + imported


def _point(name: str) -> EntryPoint:
    """Where the installed plugin ``name`` is; which of several packages was meant nobody knows."""
    by = [f"{plugin.distribution} {plugin.version}" for plugin in installed() if plugin.name == name]
    if not by:
        raise ModelError(name, "--allow-plugin", "expected an installed plugin, it is not", "install it here too")
    if len(by) > 1:
        reason = f"expected one installed plugin of this name, it is announced by {' and '.join(sorted(by))}"
        raise ModelError(name, "--allow-plugin", reason, "uninstall the others, or name a file or a folder")
    (point,) = entry_points(group=GROUP, name=name)
    return point


def _import_point(point: EntryPoint) -> None:
    try:
        point.load()
    except ModelError as error:
        _forget(point.module)
        if error.where:
            raise
        raise ModelError(point.value, error.field, error.reason, error.hint) from error
    except (Exception, SystemExit) as error:
        _forget(point.module)
        raise ModelError(point.value, "plugin", f"failed at import: {type(error).__name__}: {error}") from error
    package = point.module.partition(".")[0]
    given = [cls for registry in REGISTRIES for cls in registry.registered().values()]
    if any(edited(cls) for cls in given if cls.__module__.partition(".")[0] == package):
        _log.warning("%s: was edited since it was imported, which stays: restart the kernel or worker", point.name)


def _sources(path: Path) -> list[Source]:
    """The file, or those of a folder; where that is a package it runs first, and its files are parts of it."""
    if not path.is_dir():
        return [Source(path, _module(path))]
    members = sorted(p for p in path.glob("*.py") if not p.name.startswith(NO_PLUGINS))
    package = _module(path)
    if (path / "__init__.py").is_file():
        parts = [Source(member, f"{package}.{member.stem}", package) for member in members]
        return [Source(path / "__init__.py", package, package), *parts]
    if not members:
        raise ModelError(path, "--allow-plugin", "no Python file in this folder")
    return [Source(member, _module(member)) for member in members]


def _module(path: Path) -> str:
    place = hashlib.sha256(os.fsencode(path.resolve())).hexdigest()[:8]  # another file may have the same name
    return f"cltransfer_plugin_{path.stem}_{place}"


def _import_file(source: Source) -> str:
    if _known(source):
        return str(source.path)
    _forget(source.module)
    search = [str(source.path.parent)] if source.module == source.package else None
    spec = importlib.util.spec_from_file_location(source.module, source.path, submodule_search_locations=search)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[source.module] = module  # dataclasses look their module up
    try:
        spec.loader.exec_module(module)
    except ModelError as error:
        _forget(source.module)
        if error.where:
            raise
        raise ModelError(_file_of(source, error), error.field, error.reason, error.hint) from error
    except (Exception, SystemExit) as error:
        _forget(source.module)
        reason = f"failed at import{_line_of(source, error)}: {type(error).__name__}: {error}"
        raise ModelError(source.path, "plugin", reason, _hint(source, error)) from error
    _CODE[source.module] = source.code()
    return str(source.path)


def _file_of(source: Source, error: BaseException) -> Path:
    """The file of ``source``, or of the package that it is, that was being imported when ``error`` was raised."""
    place = source.path.parent if source.package else source.path
    files = [Path(frame.f_code.co_filename) for frame, _ in walk_tb(error.__traceback__)]
    return next((file for file in reversed(files) if file.is_relative_to(place)), source.path)


def _line_of(source: Source, error: BaseException) -> str:
    """Which line of its own file was the last, as ``, line 3``; nothing where none was run."""
    lines = [line for frame, line in walk_tb(error.__traceback__) if frame.f_code.co_filename == str(source.path)]
    return f", line {lines[-1]}" if lines else ""


def _known(source: Source) -> bool:
    """Whether it was imported, as it is now, and what it registered is there still, if it registered anything."""
    if source.module.startswith(f"{source.package}."):  # its package was looked at before
        return source.module in sys.modules
    there = _registers(source.module) or source.module in _SILENT
    return there and _CODE.get(source.module) == source.code()


def _registers(module: str) -> bool:
    return any(registry.holds(module) for registry in REGISTRIES)


def _forget(module: str) -> None:
    """Take ``module`` and what lies in it out of what is imported, and of what is registered."""
    _SILENT.discard(module)
    for registry in REGISTRIES:
        registry.forget(module)
    for name in [name for name in sys.modules if f"{name}.".startswith(f"{module}.")]:
        del sys.modules[name]


def _hint(source: Source, error: BaseException) -> str:
    """What to do about an import relative to a package that is not loaded, since that would run more than was named."""
    if not isinstance(error, ImportError) or "relative import" not in str(error):
        return ""
    folder = source.path.parent
    if not (folder / "__init__.py").is_file():
        return f"write an empty __init__.py beside it and name the folder: --allow-plugin {shlex.quote(str(folder))}"
    needed = shlex.quote(str(folder.parent if source.package else folder))
    return f"name the folder of the package that it needs: --allow-plugin {needed}"
